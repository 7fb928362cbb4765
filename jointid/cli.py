"""The command line: jointid identify, simulate, cut, report, export, convert, plan, app.

Exit codes: 0 done, 1 the input cannot be used, 2 the command was not understood. Messages and progress
go to standard error; standard output holds the result, with --json nothing but JSON.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ParamSpec, TypeVar

import typer

from jointid.elasticity import METHODS
from jointid.errors import JointIdError

if TYPE_CHECKING:
    from jointid.exporting import Identification
    from jointid.study import Analysis, Study

P = ParamSpec("P")
R = TypeVar("R")

app = typer.Typer(
    name="jointid",
    help="Stiffness and damping of elastic robot joints, and what knowing them is worth on the path.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _show_version(wanted: bool) -> None:
    if wanted:
        from jointid.exporting.identification import software_version

        print(f"jointid {software_version()}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Say which version.")
    ] = False,
) -> None:
    pass


def _reported(command: Callable[P, R]) -> Callable[P, R]:
    """One clear message instead of a traceback."""

    @wraps(command)
    def reported(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return command(*args, **kwargs)
        except JointIdError as error:
            message = str(error)
        except BrokenPipeError:  # whoever read the output has seen enough
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise typer.Exit from None
        except OSError as error:
            message = f"{error.filename or 'File'}: {error.strerror or error}."
        except (typer.Exit, typer.Abort, typer.BadParameter):
            raise
        except Exception as error:
            if os.environ.get("JOINTID_DEBUG"):
                raise
            message = (
                f"Internal error, {type(error).__name__}: {error!s:.300} This is a fault of jointid; "
                "with JOINTID_DEBUG=1 it shows where."
            )
        typer.echo(f"Error: {message}", err=True)
        raise typer.Exit(1)

    return reported


def _known_method(value: str) -> str:
    if value not in METHODS:
        raise typer.BadParameter(f'"{value}" is not known. Methods: {", ".join(METHODS)}.')
    return value


def _numbers(text: str) -> list[float]:
    """Numbers with commas between them."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise typer.BadParameter(
            f'"{text}": expected numbers with commas between, as in 43,7.5'
        ) from None


_STUDY = typer.Argument(help="Study: a folder or a .zip.", show_default=False)
_METHOD = typer.Option(callback=_known_method, help=f"Estimator: {', '.join(METHODS)}.")
_JSON = typer.Option("--json", help="Print JSON and nothing else.")


@app.command()
@_reported
def identify(
    study: Annotated[Path, _STUDY],
    method: Annotated[str, _METHOD] = "auto",
    as_json: Annotated[bool, _JSON] = False,
) -> None:
    """Find stiffness and damping of every joint."""
    from jointid.cli_results import identify_document

    analysis = _analysed(study, method, quiet=as_json)
    document = identify_document(analysis)
    if as_json:
        _print_json(document)
        return
    from jointid.rounding import plain, with_error

    fit, nominal = analysis.fit, analysis.study.nominal
    rows = []
    for k, name in enumerate(f"{letter}{j + 1}" for letter in "KD" for j in range(fit.n)):
        value = float([*fit.K, *fit.D][k])
        unit = "N·m/rad" if k < fit.n else "N·m·s/rad"
        known = "" if nominal is None else plain(float([*nominal.K, *nominal.D][k]))
        rows.append([name, with_error(value, float(fit.standard_error[k])), unit, known])
    if fit.friction is not None:
        values = [*fit.friction.coulomb, *fit.friction.viscous]
        for k, (value, error) in enumerate(zip(values, fit.friction.standard_error, strict=True)):
            unit = "N·m" if k < fit.n else "N·m·s/rad"
            name = f"{'Coulomb' if k < fit.n else 'viscous'} friction {k % fit.n + 1}"
            rows.append([name, with_error(float(value), float(error)), unit, ""])
    if fit.delay is not None:
        delay = with_error(1e3 * fit.delay, 1e3 * (fit.delay_error or 0.0))
        rows.append(["torque delay", delay, "ms", ""])
    print(f"{analysis.study.name or study.name}\n{document['answer']}\n")
    _print_table(["", "identified", "unit", "nominal"], rows, right=(1, 3))
    for finding in analysis.findings:
        remedy = f" {finding.remedy}" if finding.remedy else ""
        print(f"\n{finding.level.capitalize()}: {finding.title}. {finding.detail}{remedy}")


@app.command()
@_reported
def simulate(
    output: Annotated[Path, typer.Argument(help="New study: a folder or a .zip.", show_default=False)],
    inertia: Annotated[
        Path | None,
        typer.Option(help="TOML with M and M2 (motor side, kg·m²), or a study; else the example arm."),
    ] = None,
    drive: Annotated[str, typer.Option(help="Drive of the example arm: parallelogram, serial.")] = (
        "parallelogram"
    ),
    stiffness: Annotated[str, typer.Option("--K", help="True stiffness, N·m/rad.")] = "43,7.5",
    damping: Annotated[str, typer.Option("--D", help="True damping, N·m·s/rad.")] = "0.10,0.015",
    nominal_K: Annotated[str, typer.Option("--nominal-K", help="What the controller assumes.")] = "",
    nominal_D: Annotated[str, typer.Option("--nominal-D", help="What the controller assumes.")] = "",
    from_hz: Annotated[float, typer.Option(help="Lowest frequency.")] = 3.0,
    to_hz: Annotated[float, typer.Option(help="Highest frequency.")] = 30.0,
    count: Annotated[int, typer.Option(min=1, max=500, help="Frequencies between them.")] = 18,
    periods: Annotated[float, typer.Option(help="Length of each record in periods.")] = 12.5,
    coulomb: Annotated[str, typer.Option(help="Coulomb friction of the motors, N·m.")] = "0",
    viscous: Annotated[str, typer.Option(help="Viscous friction, N·m·s/rad.")] = "0",
    encoder_counts: Annotated[int, typer.Option(help="Per motor turn; 0 is ideal.")] = 65536,
    torque_noise: Annotated[str, typer.Option(help="Standard deviation, N·m.")] = "0.01",
    delay_ms: Annotated[float, typer.Option(help="Torque delay.")] = 0.0,
    sample_rate_hz: Annotated[float, typer.Option(help="Of control and log.")] = 2000.0,
    seed: Annotated[int, typer.Option(min=0, help="Of the noise.")] = 0,
    name: Annotated[str, typer.Option(help="Name of the study.")] = "Simulated robot",
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an existing study.")] = False,
    as_json: Annotated[bool, _JSON] = False,
) -> None:
    """Make a study from the simulated robot under joint control."""
    import numpy as np

    from jointid import (
        Controller,
        Elasticity,
        Excitation,
        Measurement,
        MotorFriction,
        PlanarArm,
        Study,
        save_study,
        simulate_records,
    )
    from jointid.cli_results import inertia_from, study_document

    lists = {k: _numbers(v) for k, v in {"K": stiffness, "D": damping}.items()}
    friction = MotorFriction(coulomb=_numbers(coulomb), viscous=_numbers(viscous))
    noise = _numbers(torque_noise)
    nominal = None
    if nominal_K or nominal_D:
        nominal = Elasticity(K=_numbers(nominal_K), D=_numbers(nominal_D))
    if inertia is None:
        arm = PlanarArm.example(drive)  # type: ignore[arg-type]  # checked there
        known = arm.inertia(arm.inverse((1.15, 0.0)))
    else:
        known = inertia_from(inertia)
    _require_free(output, overwrite)
    if not 0 < from_hz <= to_hz:
        raise JointIdError(f"--from-hz {from_hz:g} --to-hz {to_hz:g}: give 0 < lowest ≤ highest.")
    with _progress("Simulating", quiet=as_json) as progress:
        records = simulate_records(
            known,
            Elasticity(**lists),
            np.unique(np.geomspace(from_hz, to_hz, count).round(6)),
            excitation=Excitation(periods=periods),
            controller=Controller(sample_rate_hz=sample_rate_hz, torque_delay_s=1e-3 * delay_ms),
            friction=friction,
            measurement=Measurement(encoder_counts=encoder_counts or None, torque_noise_Nm=noise),
            seed=seed,
            progress=progress,
        )
    study = Study(records=records, inertia=known, nominal=nominal, name=name, origin="simulated")
    save_study(study, output, overwrite=overwrite)
    _made(study_document(study, output), study, as_json)


@app.command()
@_reported
def cut(
    study: Annotated[Path | None, typer.Argument(help="Study; else the paper's K and D.")] = None,
    zones_mm: Annotated[str, typer.Option(help="Corner zones, mm.")] = "1,5,10",
    assumed: Annotated[
        str, typer.Option(help="Servo before: study (its nominal values), rigid, soft, stiff.")
    ] = "",
    drive: Annotated[str, typer.Option(help="parallelogram, serial; by default the study's.")] = "",
    svg: Annotated[Path | None, typer.Option(help="Write the picture (Figure 7).")] = None,
    method: Annotated[str, _METHOD] = "auto",
    as_json: Annotated[bool, _JSON] = False,
) -> None:
    """Cut the paper's rectangle before and after the identification, simulated."""
    from jointid.cli_results import cut_results, demonstration_robot, write_file
    from jointid.cut.outcome import cut_robot, millimetres

    zones = _numbers(zones_mm)
    if drive not in ("", "parallelogram", "serial"):
        raise typer.BadParameter(f'--drive "{drive}": expected parallelogram or serial.')
    if assumed not in ("", "study", "rigid", "soft", "stiff"):
        raise typer.BadParameter(f'--assumed "{assumed}": expected study, rigid, soft or stiff.')
    if study is None:
        robot = demonstration_robot(drive or None)
    else:
        analysis = _analysed(study, method, quiet=as_json)
        robot = cut_robot(analysis, drive or None)  # type: ignore[arg-type]
    choice = assumed or ("study" if robot.nominal else "soft" if study is None else "rigid")
    with _progress("Cutting", quiet=as_json) as progress:
        document, outcomes = cut_results(robot, choice, zones, progress)
    document["assumption"] = choice
    if svg is not None:
        from jointid.reporting.curves import IDENTIFIED, NOMINAL
        from jointid.reporting.drawing import to_svg
        from jointid.reporting.figures import cut_figure

        labels = [f"corner zone {zone:g} mm" for zone in zones]
        rows = [
            (f"Before: {choice}", NOMINAL, [*zip(labels, (o.before for o in outcomes), strict=True)]),
            ("After", IDENTIFIED, [*zip(labels, (o.after for o in outcomes), strict=True)]),
        ]
        write_file(svg, to_svg(cut_figure(rows)).encode())
    if as_json:
        _print_json(document)
        return
    robots = "study" if study is not None else "no study: the paper's K and D on the example arm"
    print(f"Largest path error, simulated ({robots}; rule: {robot.rule}, servo before: {choice})\n")
    columns = ["corner zone", "before", "after (95 % stay below)"]
    cells = [
        [f"{zone:g} mm", millimetres(o.before_m), millimetres(o.after_m)]
        for zone, o in zip(zones, outcomes, strict=True)
    ]
    _print_table(columns, cells, right=(0, 1, 2))
    for problem in dict.fromkeys(o.problem for o in outcomes if o.problem):
        print(f"\nThe promise after is not known: {problem}")


@app.command()
@_reported
def report(
    study: Annotated[Path, _STUDY],
    output: Annotated[
        list[Path] | None, typer.Option("--output", "-o", help="Files that end in .html or .pdf.")
    ] = None,
    with_cut: Annotated[bool, typer.Option("--cut/--no-cut", help="Simulate Figure 7.")] = True,
    method: Annotated[str, _METHOD] = "auto",
    as_json: Annotated[bool, _JSON] = False,
) -> None:
    """Write a report to hand on, as one HTML file or as PDF."""
    from jointid.cli_results import write_file

    files = output or [Path(f"{study.resolve().stem or 'study'}-report.html")]
    for file in files:
        if file.suffix.lower() not in (".html", ".htm", ".pdf"):
            raise typer.BadParameter(f"--output {file}: expected a name that ends in .html or .pdf.")
    analysis = _analysed(study, method, quiet=as_json)
    from jointid.reporting.report import make_report, to_html, to_pdf

    with _status("Writing the report", quiet=as_json):
        made = make_report(analysis, cut=with_cut)
        for file in files:
            pdf = file.suffix.lower() == ".pdf"
            write_file(file, to_pdf(made) if pdf else to_html(made).encode())
    _written(files, as_json)


@app.command()
@_reported
def export(
    study: Annotated[Path, _STUDY],
    output: Annotated[
        list[Path],
        typer.Option(
            "--output",
            "-o",
            help="Files; the ending says what: .json, .toml (K, D and how they were obtained), .mat, "
            ".phasors.csv, .H.csv, .zip (the study), .xml (MuJoCo), .urdf, .sdf.",
        ),
    ],
    gear_ratio: Annotated[
        str, typer.Option(help="Motor turns per joint turn, for .xml, .urdf and .sdf.")
    ] = "",
    method: Annotated[str, _METHOD] = "auto",
    as_json: Annotated[bool, _JSON] = False,
) -> None:
    """Write results for other tools."""
    from jointid.cli_results import write_file

    ratio = _numbers(gear_ratio) if gear_ratio else None
    for file in output:
        ending = _ending(file)
        if ending in (".xml", ".urdf", ".sdf") and ratio is None:
            raise typer.BadParameter(f"{file.name} is on the arm side: give --gear-ratio, as in 100,90")
    analysis = _analysed(study, method, quiet=as_json)
    from jointid.exporting import identification

    result = identification(analysis)
    for file in output:
        write_file(file, _exported(_ending(file), analysis, result, ratio))
    _written(output, as_json)


_ENDINGS = (".phasors.csv", ".h.csv", ".json", ".toml", ".mat", ".zip", ".xml", ".urdf", ".sdf")


def _ending(file: Path) -> str:
    for ending in _ENDINGS:
        if file.name.lower().endswith(ending):
            return ending
    raise typer.BadParameter(f"{file.name}: expected a name that ends in one of {', '.join(_ENDINGS)}.")


def _exported(
    ending: str, analysis: Analysis, result: Identification, ratio: list[float] | None
) -> bytes:
    from jointid import exporting

    if ending == ".mat":
        return exporting.to_mat(analysis)
    if ending == ".zip":
        from jointid.study_files import pack_study

        return pack_study(analysis.study)
    if ending in (".phasors.csv", ".h.csv"):
        table = exporting.phasor_table if ending == ".phasors.csv" else exporting.transfer_matrix_table
        return table(analysis).encode()
    if ending in (".json", ".toml"):
        return (exporting.to_json if ending == ".json" else exporting.to_toml)(result).encode()
    snippets = {
        ".xml": exporting.mujoco_snippet,
        ".urdf": exporting.urdf_snippet,
        ".sdf": exporting.sdf_snippet,
    }
    return snippets[ending](result, ratio or []).encode()


@app.command()
@_reported
def plan(
    study: Annotated[Path, _STUDY],
    count: Annotated[int, typer.Option(min=1, max=50, help="How many records.")] = 3,
    duration_s: Annotated[float, typer.Option(help="Length of each.")] = 4.0,
    torque_limit: Annotated[str, typer.Option(help="Largest amplitudes, N·m; else as so far.")] = "",
    velocity_limit: Annotated[str, typer.Option(help="Largest amplitudes, rad/s; else as so far.")] = "",
    method: Annotated[str, _METHOD] = "auto",
    as_json: Annotated[bool, _JSON] = False,
) -> None:
    """Say which records to make next, and what they would bring."""
    from jointid.cli_results import plan_document

    torque = _numbers(torque_limit) if torque_limit else None
    velocity = _numbers(velocity_limit) if velocity_limit else None
    loaded = _loaded(study)
    with _status("Planning", quiet=as_json):
        document = plan_document(
            loaded,
            method=method,
            count=count,
            duration_s=duration_s,
            torque_limit=torque,
            velocity_limit=velocity,
        )
    if as_json:
        _print_json(document)
        return
    names = document["parameters"]
    rows = [["today", "", "", *(f"{100 * e:.2g} %" for e in document["relative_error_today"])]]
    for k, record in enumerate(document["records"], start=1):
        pairs = zip(record["torque_Nm"], record["torque_phase_deg"], strict=True)
        torques = ", ".join(f"{size:.3g} ∠ {phase:.0f}°" for size, phase in pairs)
        errors = (f"{100 * e:.2g} %" for e in record["relative_error_after"])
        rows.append([f"record {k}", f"{record['frequency_hz']:.3g}", torques, *errors])
    print("Records to make next, and the relative standard errors after each\n")
    _print_table(
        ["", "Hz", "torque amplitudes (N·m)", *names], rows, right=(1, *range(3, 3 + len(names)))
    )


@app.command()
@_reported
def convert(
    logs: Annotated[list[Path], typer.Argument(help="Logs with the same columns.", show_default=False)],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="New study: a folder or a .zip.")
    ] = None,
    mapping: Annotated[
        Path | None, typer.Option(help="JSON that says which column is what, as --guess writes it.")
    ] = None,
    guess: Annotated[
        Path | None, typer.Option(help="Write the guessed mapping to this file and stop.")
    ] = None,
    inertia: Annotated[
        Path | None, typer.Option(help="TOML with M and M2 (motor side, kg·m²), or a study.")
    ] = None,
    nominal_K: Annotated[str, typer.Option("--nominal-K", help="What the controller assumes.")] = "",
    nominal_D: Annotated[str, typer.Option("--nominal-D", help="What the controller assumes.")] = "",
    name: Annotated[str, typer.Option(help="Name of the study.")] = "",
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an existing study.")] = False,
    as_json: Annotated[bool, _JSON] = False,
) -> None:
    """Make a study of the sine runs in any controller's logs."""
    if (guess is None) == (mapping is None):
        raise typer.BadParameter(
            "Give --guess FILE first, look at the mapping it writes, then convert with --mapping FILE."
        )
    from jointid import Elasticity, save_study
    from jointid.cli_results import inertia_from, mapped_study, study_document, write_file
    from jointid.importing import guess_mapping, mapping_from_json, mapping_to_json, read_log

    with _status("Reading", quiet=as_json):
        tables = [read_log(log)[0] for log in logs]
    if guess is not None:
        guessed = guess_mapping(tables[0])
        write_file(guess, (mapping_to_json(guessed.mapping) + "\n").encode())
        if as_json:
            _print_json(
                {
                    "mapping": json.loads(mapping_to_json(guessed.mapping)),
                    "reasons": [
                        {"what": r.what, "text": r.text, "sure": r.sure} for r in guessed.reasons
                    ],
                }
            )
            return
        rows = [[r.what, "" if r.sure else "look", r.text] for r in guessed.reasons]
        _print_table(["entry", "", "reason"], rows)
        print(f"\n{guess} is written. Correct it, then: jointid convert … --mapping {guess}")
        return
    if mapping is None or output is None or inertia is None:
        raise typer.BadParameter("A conversion needs --mapping, --inertia and --output.")
    nominal = None
    if nominal_K or nominal_D:
        nominal = Elasticity(K=_numbers(nominal_K), D=_numbers(nominal_D))
    known = inertia_from(inertia)
    chosen = mapping_from_json(mapping.read_bytes())
    _require_free(output, overwrite)
    with _status("Looking for sine runs", quiet=as_json):
        study, notes = mapped_study(tables, chosen, known, nominal, name)
    save_study(study, output, overwrite=overwrite)
    _made(study_document(study, output) | {"notes": list(notes)}, study, as_json)
    for note in notes:
        typer.echo(note, err=True)


@app.command(name="app")
@_reported
def start_app(
    port: Annotated[int, typer.Option(min=1, max=65535, help="Where it listens.")] = 8501,
    path: Annotated[
        Path | None, typer.Option(help="Another app.py than the one of the checkout.")
    ] = None,
) -> None:
    """Start the app in the browser."""
    script = (path or Path(__file__).resolve().parents[1] / "app.py").resolve()
    if not script.is_file():
        raise JointIdError(
            f"{script} is not there. The app stands beside the package in a checkout of the source: "
            "install with pip install -e, or name it with --path."
        )
    command = [sys.executable, "-m", "streamlit", "run", str(script), f"--server.port={port}"]
    try:
        code = subprocess.run(command, cwd=script.parent, check=False).returncode
    except KeyboardInterrupt:
        return
    if code:
        raise JointIdError(f"The app ended with code {code}; what streamlit wrote above says why.")


def _loaded(path: Path) -> Study:
    from jointid.study_files import load_study

    return load_study(path)


def _analysed(path: Path, method: str, *, quiet: bool) -> Analysis:
    from jointid.study import analyse

    study = _loaded(path)
    with _status("Analysing", quiet=quiet):
        return analyse(study, method=method)


def _require_free(path: Path, overwrite: bool) -> None:
    """Refuse before the work is done rather than after it."""
    if path.exists() and not overwrite:
        raise JointIdError(f"{path} exists: choose another path, or replace it with --overwrite.")


def _made(document: dict[str, Any], study: Study, as_json: bool) -> None:
    if as_json:
        _print_json(document)
        return
    count, n = len(study.records), study.inertia.n
    print(f"{document['study']}: {count} records of {n} joint(s), digest {document['digest']}")


def _written(files: list[Path], as_json: bool) -> None:
    if as_json:
        _print_json({"written": [str(file) for file in files]})
        return
    for file in files:
        print(f"{file}: {file.stat().st_size} bytes")


def _print_json(document: dict[str, Any]) -> None:
    from jointid.cli_results import finite

    print(json.dumps(finite(document), indent=2, ensure_ascii=False, allow_nan=False))


def _print_table(header: list[str], rows: list[list[str]], *, right: tuple[int, ...] = ()) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for k, title in enumerate(header):
        table.add_column(Text(title), justify="right" if k in right else "left")
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    Console(width=None if sys.stdout.isatty() else 200).print(table)


@contextmanager
def _status(what: str, *, quiet: bool) -> Iterator[None]:
    """Say what is being done, to a person at a terminal."""
    if quiet or not sys.stderr.isatty():
        yield
        return
    from rich.console import Console

    with Console(stderr=True).status(what):
        yield


@contextmanager
def _progress(what: str, *, quiet: bool) -> Iterator[Callable[[float], None]]:
    """A bar with the time that is left, to a person at a terminal."""
    if quiet or not sys.stderr.isatty():
        yield lambda fraction: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda fraction: bar.update(task, completed=fraction)


if __name__ == "__main__":
    app()
