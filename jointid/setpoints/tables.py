"""CSV tables of joint angles: plain ones in rad, and in degrees for programs that stream them.

Those are ABB Externally Guided Motion and KUKA RobotSensorInterface, which takes axis corrections.
"""

from collections.abc import Iterator

from jointid.setpoints.file_format import Format, SetPoints


def _table(points: SetPoints, counter: str, axis: str) -> Iterator[str]:
    """CSV with a counter, the time and one column per axis, whose name holds its number at "#"."""
    yield from points.comments
    axes = range(1, points.values.shape[1] + 1)
    yield ",".join([counter, "time_ms", *(axis.replace("#", str(k)) for k in axes)])
    for k, row in enumerate(points.values):
        yield ",".join(
            [
                str(k),
                f"{k * points.interval_ms:.9g}",
                *(f"{value:.{points.format.decimals}f}" for value in row.tolist()),
            ]
        )


CSV = Format("csv", "CSV", ".csv", lambda points: _table(points, "sample", "axis_#_rad"))
EGM = Format(
    name="egm",
    title="ABB EGM",
    ending=".egm.csv",
    write=lambda points: _table(points, "seqno", "joint_#_deg"),
    intervals_ms=(4.0, 8.0, 12.0, 16.0, 20.0, 24.0),
    axes=(6, 7),
    degrees=True,
    notes=(
        "EGM: joint angles in degrees for planned.joints of EgmSensor, one row per message. EGMActJoint",
        "with \\SampleRate as the interval here and \\MaxSpeedDeviation above the largest velocities,",
        "then EGMRunJoint. Its filter and gain change amplitudes; the log shows which.",
        "EGM bypasses path planning and collision supervision of the controller.",
    ),
)
RSI = Format(
    name="rsi",
    title="KUKA RSI",
    ending=".rsi.csv",
    write=lambda points: _table(points, "cycle", "A#_deg"),
    intervals_ms=(4.0, 12.0),
    axes=(4, 5, 6),
    degrees=True,
    from_start=True,
    notes=(
        "RSI: corrections of the axes in degrees, relative to the pose at RSI_ON(#ABSOLUTE); with",
        "#RELATIVE they would add up. 4 ms for IPO_FAST, 12 ms for IPO. One row per telegram, with its",
        "IPOC. Set the limits of AXISCORR and AXISCORRMON just above the ranges below.",
        "RSI bypasses path planning of the controller; corrections act in T1 as well.",
    ),
)
