"""File formats of set points.

CSV of joint angles, plain in rad or in degrees for programs that stream them (ABB Externally Guided
Motion; KUKA RobotSensorInterface, which takes axis corrections); a trajectory for ROS 2; a script for
Universal Robots.
"""

import json
from collections.abc import Iterator

from jointid.setpoints.file_format import Format, SetPoints, numbers


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


_CSV = Format("csv", "CSV", ".csv", lambda points: _table(points, "sample", "axis_#_rad"))
_EGM = Format(
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
        "then EGMRunJoint. Its filter and gain change amplitudes; the log shows by how much.",
        "EGM bypasses path planning and collision supervision of the controller.",
    ),
)
_RSI = Format(
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


def _trajectory(points: SetPoints) -> Iterator[str]:
    """A trajectory_msgs/JointTrajectory message as YAML."""
    yield from points.comments
    yield "header: {stamp: {sec: 0, nanosec: 0}, frame_id: ''}"
    yield f"joint_names: {json.dumps(points.robot.joint_names)}"
    yield "points:"
    # The controller starts from where the robot is: the first point comes one interval later.
    for k in range(1, len(points.values)):
        seconds, nanoseconds = divmod(round(1e6 * points.interval_ms * k), 10**9)
        yield (
            f"- {{positions: [{numbers(points.values[k], 9)}], "
            f"velocities: [{numbers(points.motion.velocity[k], 9)}], "
            f"accelerations: [{numbers(points.motion.acceleration[k], 9)}], "
            f"time_from_start: {{sec: {seconds}, nanosec: {nanoseconds}}}}}"
        )


_ROS2 = Format(
    name="ros2",
    title="ROS 2 JointTrajectory",
    ending=".yaml",
    write=_trajectory,
    intervals_ms=(4.0, 1.0, 2.0, 5.0, 8.0, 10.0, 20.0),
    notes=(
        "ROS 2: for a joint_trajectory_controller of all axes with spline interpolation. Set its path",
        "tolerances, so that it aborts when the robot does not follow.",
    ),
)


def _script(points: SetPoints) -> Iterator[str]:
    """URScript with one servoj per set point."""
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


_UR = Format(
    name="ur",
    title="Universal Robots URScript",
    ending=".script",
    write=_script,
    intervals_ms=(2.0, 8.0),
    axes=(6,),
    notes=(
        "URScript: 2 ms for e-Series, 8 ms for CB3. Speed slider at 100 %: speed scaling, also by the",
        "robot itself, stretches the time and changes the frequencies. servoj (lookahead time 0.03 s,",
        "gain 1000) lowers amplitudes at high frequencies; the log shows how much. The program stops",
        "unless the robot is at the start pose.",
    ),
)
FORMATS = {each.name: each for each in (_CSV, _ROS2, _UR, _EGM, _RSI)}
"""File formats by name."""
