"""Head of a file of set points: robot, check, what to log, and safety."""

from collections.abc import Iterable

from jointid.files.application import __version__
from jointid.setpoints.file_format import Format
from jointid.setpoints.limit_check import LimitRow
from jointid.setpoints.played import PlayedExperiment
from jointid.setpoints.robot_limits import RobotLimits

_SAFETY = (
    "The check below uses a simulated robot, for small motions around the start pose. It does not",
    "cover collisions, cables, tool and workpiece, tool speed, singularities, or wrong inertias, K, D",
    "and limits. It is not a safety function and replaces no risk assessment (ISO 10218).",
    "Release: a person responsible for this cell. Safety-rated monitoring of speed, space and stop",
    "remains on; nobody is in the safeguarded space; an emergency stop is within reach.",
    "First run: in the maker's simulator, then on the robot with a file of scale 0.1 at reduced speed,",
    "then in steps. Clear the whole range of the joints below, with tool and workpiece.",
    "The experiment excites resonances on purpose: secure tool, hoses and workpiece. Stop at growing",
    "vibration, following errors or hot drives. It starts and ends at the start pose, at rest.",
)


def head(
    played: PlayedExperiment,
    robot: RobotLimits,
    chosen: Format,
    count: int,
    interval_ms: float,
    rows: tuple[LimitRow, ...],
    study: str,
) -> tuple[str, ...]:
    """Return the lines of a head."""
    experiment = played.experiment
    axes, rate_hz = _list(robot.axes), max(1e3 / interval_ms, 8 * experiment.highest_hz)
    return (
        f"jointid {__version__}: set points of an experiment. NOT RUN ON HARDWARE.",
        f"Study: {_one_line(study)}. Robot: {_one_line(robot.robot)}.",
        f"Joints of the study: axes {axes}, gear ratios {_list(robot.gear_ratio)}; others stay still.",
        f"Start and end pose (deg): {_list(robot.start_deg)}.",
        f"Duration: {experiment.duration_s:.3f} s, {count} set points every {interval_ms:g} ms. "
        f"Scale: {experiment.scale:g}.",
        "",
        "SAFETY",
        *_SAFETY,
        *chosen.notes,
        "",
        "CHECK (joint side, torque motor side)",
        *(
            f"joint {row.joint} {row.quantity}: {row.peak:.4g}, limit {row.limit:.4g} "
            f"{row.unit}, margin {row.margin:.3g} ({row.where})"
            for row in rows
        ),
        f"Simulated with K = {_list(played.elasticity.K)} N·m/rad, D = {_list(played.elasticity.D)} "
        f"N·m·s/rad, Coulomb friction {_list(played.coulomb_Nm)} N·m,",
        f"load at rest {_list(robot.load_Nm)} N·m.",
        "",
        "LOG",
        f"Time, motor positions and motor torques (or currents) of axes {axes} on one clock, without",
        f"filters, at {rate_hz:.0f} Hz or more, from start to end. Measured positions, not set points.",
        "Note whether the torque is commanded or measured, its delay, and the torque constant.",
        "Full amplitude, in s from the first set point:",
        *(f"{run.label}: {begin:.3f} to {end:.3f}" for run, begin, end in experiment.spans()),
    )


def _list(values: Iterable[float]) -> str:
    return ", ".join(f"{value:.6g}" for value in values)


def _one_line(text: str) -> str:
    """Text of a user that cannot end the comment."""
    line = " ".join("".join(c if c.isprintable() else " " for c in text).split())[:200]
    return line or "without a name"
