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
    chosen, interval = _format(file_format, interval_ms)
    experiment, start = simulated.experiment, robot.start_deg
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


def highest_hz(file_format: str, interval_ms: float | None = None) -> float:
    """Highest frequency of a motion in a format, Hz.

    Raises JointIdError when the format or the interval does not exist.
    """
    return 1e3 / (_FEWEST_PER_PERIOD * _format(file_format, interval_ms)[1])


def _format(name: str, interval_ms: float | None) -> tuple[Format, float]:
    """A format and its interval, ms."""
    if name not in FORMATS:
        raise JointIdError(f'Format "{name}": expected one of {", ".join(FORMATS)}.')
    chosen = FORMATS[name]
    possible = chosen.intervals_ms
    interval = float(interval_ms or (*possible, 1.0)[0])
    if interval not in (possible or (interval,)) or not 0.05 <= interval <= 100:
        names = enumerated([f"{value:g}" for value in sorted(possible)]) if possible else "0.05 to 100"
        raise JointIdError(f"{chosen.title}: {interval:g} ms; possible intervals: {names} ms.")
    return chosen, interval


def _require_possible(
    chosen: Format, interval_ms: float, robot: RobotLimits, simulated: SimulatedExperiment
) -> None:
    axes, n = robot.start_deg.size, simulated.coulomb_Nm.size
    highest, most = simulated.experiment.highest_hz, highest_hz(chosen.name, interval_ms)
    if highest > most * (1 + 1e-9):
        allowed = np.floor(100 * most + 1e-9) / 100  # rounded up, it would be refused as well
        shorter = min(chosen.intervals_ms, default=0.0) < interval_ms
        raise JointIdError(
            f"{significant(highest)} Hz has fewer than {_FEWEST_PER_PERIOD} set points per period at "
            f"{interval_ms:g} ms: plan up to {allowed:.2f} Hz{', or shorten the interval' * shorter}."
        )
    if robot.gear_ratio.size != n:
        limits = counted(robot.gear_ratio.size, "joint")
        raise JointIdError(
            f"The experiment has {counted(n, 'joint')}, but the limits are for {limits}: give all."
        )
    if chosen.axes and axes not in chosen.axes:
        raise JointIdError(
            f"{chosen.title} needs the start angles of {' or '.join(map(str, chosen.axes))} axes, got "
            f"{axes}: give the angle of every axis of the robot."
        )
