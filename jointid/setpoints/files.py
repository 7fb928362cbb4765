"""From a simulated experiment to a checked file of set points."""

import numpy as np

from jointid.errors import JointIdError
from jointid.setpoints.experiment import Motion
from jointid.setpoints.file_format import Format, SetPoints
from jointid.setpoints.formats import FORMATS
from jointid.setpoints.limit_check import check_limits
from jointid.setpoints.robot_limits import RobotLimits
from jointid.setpoints.simulated_experiment import Peaks, SimulatedExperiment
from jointid.wording import counted, enumerated, significant

_FEWEST_PER_PERIOD = 5
"""Fewest set points per period: with fewer, the controller's interpolation changes the sine."""


def set_points(
    simulated: SimulatedExperiment,
    robot: RobotLimits,
    file_format: str,
    *,
    interval_ms: float | None = None,
    study: str = "",
) -> SetPoints:
    """Make set points of a simulated experiment and check them against the limits of the same joints.

    The format is one of ``FORMATS``, whose interval is the default; ``study`` is the name of the study,
    for the head of the file. Raises JointIdError when the format does not exist or does not fit the
    robot or the frequencies.
    """
    if file_format not in FORMATS:
        raise JointIdError(f'Format "{file_format}": expected one of {", ".join(FORMATS)}.')
    chosen, experiment, start = FORMATS[file_format], simulated.experiment, robot.start_deg
    interval = float(interval_ms or (*chosen.intervals_ms, 1.0)[0])
    _require_possible(chosen, interval, robot, simulated)
    step = 1e-3 * interval
    time = np.arange(np.ceil(experiment.duration_s / step - 1e-9) + 1) * step
    motion = Motion(*np.zeros((3, time.size, start.size)))
    for whole, part in zip(motion, experiment.motion(time), strict=True):
        whole[:, list(robot.moving)] = part / robot.gear_ratio
    # The check sees the written values, rounding included.
    unit = 1.0 if chosen.degrees else np.radians(1.0)
    offset = 0.0 if chosen.from_start else start
    values = np.round(unit * (np.degrees(motion.position) + offset), chosen.decimals) + 0.0
    written = np.asarray(values / unit - offset, np.float64)[:, list(robot.moving)]
    points = [Peaks.of("position", "set points", time, written)]
    for order, quantity in enumerate(("velocity", "acceleration"), start=1):
        exact = np.degrees(motion[order])[:, list(robot.moving)]
        slopes = np.diff(written, order, axis=0) / step**order
        points += [Peaks.of(quantity, "set points", time, each) for each in (exact, slopes)]
    rows = check_limits(simulated, robot, points)
    return SetPoints(chosen, interval, values, motion, robot, simulated, rows, study)


def _require_possible(
    chosen: Format, interval_ms: float, robot: RobotLimits, simulated: SimulatedExperiment
) -> None:
    possible, axes, n = chosen.intervals_ms, robot.start_deg.size, simulated.coulomb_Nm.size
    highest, most = simulated.experiment.highest_hz, 1e3 / (_FEWEST_PER_PERIOD * interval_ms)
    if interval_ms not in (possible or (interval_ms,)) or not 0.05 <= interval_ms <= 100:
        names = enumerated([f"{value:g}" for value in sorted(possible)]) if possible else "0.05 to 100"
        raise JointIdError(f"{chosen.title}: {interval_ms:g} ms; possible intervals: {names} ms.")
    if highest > most * (1 + 1e-9):
        raise JointIdError(
            f"{significant(highest)} Hz has fewer than {_FEWEST_PER_PERIOD} set points per period at "
            f"{interval_ms:g} ms: plan up to {significant(most)} Hz, or shorten the interval."
        )
    if robot.gear_ratio.size != n:
        limits = counted(robot.gear_ratio.size, "joint")
        raise JointIdError(
            f"The experiment has {counted(n, 'joint')}, the limits are for {limits}: give all."
        )
    if chosen.axes and axes not in chosen.axes:
        raise JointIdError(
            f"{chosen.title} needs the start angles of {' or '.join(map(str, chosen.axes))} axes, got "
            f"{axes}: give the angle of every axis of the robot."
        )
