"""ROS 2: a trajectory_msgs/JointTrajectory message as YAML."""

import json
from collections.abc import Iterator

from jointid.setpoints.file_format import Format, SetPoints, numbers


def _write(points: SetPoints) -> Iterator[str]:
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


FORMAT = Format(
    name="ros2",
    title="ROS 2 JointTrajectory",
    ending=".yaml",
    write=_write,
    intervals_ms=(4.0, 1.0, 2.0, 5.0, 8.0, 10.0, 20.0),
    notes=(
        "ROS 2: for a joint_trajectory_controller of all axes with spline interpolation. Set its path",
        "tolerances, so that it aborts when the robot does not follow.",
    ),
)
