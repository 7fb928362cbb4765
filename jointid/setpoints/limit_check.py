"""Peaks of a simulated experiment against the limits of the robot."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointid.errors import JointIdError
from jointid.setpoints.robot_limits import RobotLimits
from jointid.setpoints.simulated_experiment import Peaks, SimulatedExperiment
from jointid.wording import significant

_RESERVE = 0.95
"""Share of the largest scale that a refusal suggests; friction is not proportional to the motion."""


@dataclass(frozen=True)
class LimitRow:
    """Largest value of one quantity of one joint against its limit."""

    joint: int
    """From 1."""
    quantity: str
    """With "lowest" or "highest" of a position."""
    unit: str
    limit: float
    peak: float
    at_rest: float
    """Its value at rest in the start pose, which does not change with the motion scale."""
    where: str
    """Run, time and signal of the peak."""

    @property
    def margin(self) -> float:
        """Distance to the limit, negative beyond it."""
        return self._below_limit(self.peak)

    @property
    def possible_scale(self) -> float:
        """Factor on the motion that just meets an exceeded limit; 0 when rest exceeds it already."""
        if self.margin >= 0:
            return np.inf
        return max(self._below_limit(self.at_rest), 0.0) / abs(self.peak - self.at_rest or 1.0)

    def _below_limit(self, value: float) -> float:
        return (self.limit - value) * (-1 if self.quantity.startswith("lowest") else 1)


def check_limits(
    simulated: SimulatedExperiment, robot: RobotLimits, points: Sequence[Peaks]
) -> tuple[LimitRow, ...]:
    """Compare the simulated experiment and its set points with the limits of the robot.

    ``points`` are the peaks of the set points and their derivatives, joint side, in degrees relative to
    the start pose. The rows are by joint: lowest and highest position, velocity, acceleration and
    torque.
    """
    ratio, start = robot.gear_ratio, robot.start_deg[list(robot.moving)]
    zero = np.zeros(ratio.size)
    load = np.abs(robot.load_Nm) * (1 + simulated.load_friction)
    peaks = list(points)
    for each in simulated.peaks:
        values = each.values if each.quantity == "torque" else np.degrees(each.values / ratio)
        peaks.append(each._replace(values=values))
    tables = (
        ("lowest position", "°", "lower_deg", start),
        ("highest position", "°", "upper_deg", start),
        ("velocity", "°/s", "velocity_deg_s", zero),
        ("acceleration", "°/s²", "acceleration_deg_s2", zero),
        ("torque", "N·m", "torque_Nm", load),  # its direction is not known: it adds to the peak
    )
    rows = []
    for j in range(ratio.size):
        for quantity, unit, limit, offset in tables:
            sign = {"lowest": -1.0, "highest": 1.0}.get(quantity.split()[0])
            peak, where = -np.inf, ""
            for name, source, values, time in peaks:
                if quantity.endswith(name):
                    column = np.abs(values[:, j]) if sign is None else sign * values[:, j]
                    k = int(np.argmax(column))
                    if column[k] > peak:
                        run = simulated.experiment.run_at(time[k, j])
                        peak, where = float(column[k]), f"{run}, {time[k, j]:.3f} s, {source}"
            at_rest = offset[j] + (simulated.coulomb_Nm[j] if quantity == "torque" else 0.0)
            reached = float(offset[j] + (sign or 1.0) * peak)
            bound = float(getattr(robot, limit)[j])
            rows.append(LimitRow(j + 1, quantity, unit, bound, reached, float(at_rest), where))
    return tuple(rows)


def check_table(rows: Sequence[LimitRow]) -> dict[str, list[str]]:
    """Return limit, peak and margin by joint and quantity, as columns of text."""
    return {
        "Joint": [str(row.joint) for row in rows],
        "Quantity": [f"{row.quantity} ({row.unit})" for row in rows],
        "Limit": [significant(row.limit) for row in rows],
        "Peak": [significant(row.peak) for row in rows],
        "Margin": [significant(row.margin, 3) + " ✗" * (row.margin < 0) for row in rows],
        "Where": [row.where for row in rows],
    }


def require_within_limits(rows: Sequence[LimitRow], scale: float) -> None:
    """Refuse an experiment beyond a limit; the remedy names a scale that stays within all limits.

    Raises JointIdError with the limit that needs the smallest scale: joint, record, time and remedy.
    """
    worst = min(rows, key=lambda row: row.possible_scale)
    if worst.margin >= 0:
        return
    factor = _RESERVE * scale * worst.possible_scale
    if factor > 0:
        place = 10.0 ** (np.floor(np.log10(factor)) - 1)
        smaller = np.floor(factor / place) * place
        remedy = f"Set the motion scale to {smaller:.3g} (now {scale:g})."
    else:
        remedy = "The motion is not the cause: choose another start pose, or check load and friction."
    raise JointIdError(
        f"The {worst.quantity} of joint {worst.joint} reaches {significant(worst.peak)} {worst.unit} "
        f"({worst.where}); its limit is {significant(worst.limit)} {worst.unit}.",
        hint=remedy,
    )
