"""Universal Robots: URScript with one servoj per set point."""

from collections.abc import Iterator

from jointid.setpoints.file_format import Format, SetPoints, numbers


def _write(points: SetPoints) -> Iterator[str]:
    moving = sorted(points.robot.moving)
    start = numbers(points.values[0], 9)
    target = start.split(", ")
    for k in moving:
        target[k] = f"a{k + 1}"
    yield from points.comments
    yield from (
        "def jointid_experiment():",
        f"  start = [{start}]",
        "  actual = get_actual_joint_positions()",
        "  k = 0",
        "  while k < 6:",
        "    if norm(actual[k] - start[k]) > 0.005:",
        '      popup("The robot is not at the start pose", "jointid", error=True, blocking=True)',
        "      halt",
        "    end",
        "    k = k + 1",
        "  end",
        f"  def s({', '.join(target[k] for k in moving)}):",
        f"    servoj([{', '.join(target)}], 0, 0, {1e-3 * points.interval_ms:g}, 0.03, 1000)",
        "  end",
        *(f"  s({numbers(row, 9)})" for row in points.values[:, moving]),
        "  stopj(2.0)",
        "end",
    )


FORMAT = Format(
    name="ur",
    title="Universal Robots URScript",
    ending=".script",
    write=_write,
    intervals_ms=(2.0, 8.0),
    axes=(6,),
    notes=(
        "URScript: 2 ms for e-Series, 8 ms for CB3. Speed slider at 100 %: speed scaling, also by the",
        "robot itself, stretches the time and changes the frequencies. servoj (lookahead time 0.03 s,",
        "gain 1000) lowers amplitudes at high frequencies; the log shows which. The program stops",
        "unless the robot is at the start pose.",
    ),
)
