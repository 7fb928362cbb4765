"""The command line: jointid identify, compare, simulate, cut, report, export, plan, setpoints, …

Exit codes: 0 done, 1 unusable input, 2 usage error, 130 interrupted. Messages and progress go to
standard error, the result to standard output; with --json it is JSON only.
"""

try:
    from jointid.cli.batch import batch
    from jointid.cli.compare import compare
    from jointid.cli.convert import convert
    from jointid.cli.cut import cut
    from jointid.cli.export import export, report
    from jointid.cli.identify import arm_side, identify
    from jointid.cli.plan import plan, setpoints
    from jointid.cli.program import Command, app, start_app
    from jointid.cli.simulate import simulate
except KeyboardInterrupt:  # during the imports
    raise SystemExit(130) from None

__all__ = ["app"]

for _command in (
    identify,
    compare,
    simulate,
    cut,
    report,
    export,
    plan,
    setpoints,
    convert,
    arm_side,
    batch,
):
    app.command(cls=Command)(_command)
app.command(name="app", cls=Command)(start_app)
