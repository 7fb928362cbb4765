"""Set points of a robot, the head of their file, and the properties of a file format."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from jointid.arrays import Floats
from jointid.files.application import __version__
from jointid.setpoints.experiment import Motion
from jointid.setpoints.limit_check import LimitRow, require_within_limits
from jointid.setpoints.robot_limits import RobotLimits
from jointid.setpoints.simulated_experiment import SimulatedExperiment
from jointid.wording import printable

_ASCII = str.maketrans({"−": "-", "·": " ", "°": "deg", "²": "^2"})
"""Controllers may refuse other characters, in comments too."""
_SAFETY = (
    "The check below uses a simulated robot, for small motions around the start pose. It does not",
    "cover collisions, cables, tool and workpiece, tool speed, singularities, or wrong inertias, K, D",
    "and limits. It is not a safety function and does not replace a risk assessment (ISO 10218).",
    "Release: by the person responsible for this cell. Safety-rated monitoring of speed, space and stop",
    "remains on; nobody is in the safeguarded space; an emergency stop is within reach.",
    "First run: in the manufacturer's simulator, then on the robot with a file of scale 0.1, at reduced",
    "speed; then in steps. Keep the whole range of the joints below clear for arm, tool and workpiece.",
    "The experiment excites resonances on purpose: secure tool, hoses and workpiece. Stop if vibration",
    "or following errors grow, or drives overheat. It starts and ends at the start pose, at rest.",
)


@dataclass(frozen=True)
class Format:
    """A file format of set points."""

    name: str
    title: str
    ending: str
    write: Callable[[SetPoints], Iterator[str]]
    """The lines of a file."""
    intervals_ms: tuple[float, ...] = ()
    """Possible intervals, the default first; empty: any."""
    axes: tuple[int, ...] = ()
    """Possible numbers of axes; empty: any."""
    degrees: bool = False
    """Whether the values are degrees instead of radians."""
    from_start: bool = False
    """Whether the values are differences to the start pose."""
    notes: tuple[str, ...] = ()
    """Remarks on the use of the file, for its head."""

    @property
    def decimals(self) -> int:
        """Decimals of the values: about 1e-9 rad."""
        return 7 if self.degrees else 9


@dataclass(frozen=True, eq=False)
class SetPoints:
    """Set points of all m axes of a robot as they are written."""

    format: Format
    interval_ms: float
    values: Floats
    """In the unit of the format, rounded to its decimals, shape (N, m)."""
    motion: Motion
    """The motion of all axes from the start pose, rad and s, each (N, m)."""
    robot: RobotLimits
    simulated: SimulatedExperiment
    rows: tuple[LimitRow, ...]
    """Check against the limits."""
    study: str
    """Name of the study."""

    @property
    def scale(self) -> float:
        """Factor on all motion, as chosen by the user."""
        return self.simulated.experiment.scale

    def text(self) -> str:
        """Return the file.

        Raises JointIdError when a limit is exceeded.
        """
        require_within_limits(self.rows, self.scale)
        return "\n".join([*self.format.write(self), ""])

    @property
    def comments(self) -> list[str]:
        """The head as comments in ASCII: robot, check, what to log, and safety."""
        lines = (line.translate(_ASCII).encode("ascii", "replace").decode() for line in _head(self))
        return [f"# {line}".rstrip() for line in lines]


def _head(points: SetPoints) -> Iterator[str]:
    robot, simulated, experiment = points.robot, points.simulated, points.simulated.experiment
    axes, rate_hz = _list(robot.axes), max(1e3 / points.interval_ms, 15 * experiment.highest_hz)
    yield from (
        f"jointid {__version__}: set points of an experiment. NOT RUN ON HARDWARE.",
        f"Study: {_one_line(points.study)}. Robot: {_one_line(robot.robot)}.",
        f"Joints of the study: axes {axes}, gear ratios {_list(robot.gear_ratio)}; others stand still.",
        f"Start and end pose (deg): {_list(robot.start_deg)}.",
        f"Duration: {experiment.duration_s:.3f} s, {len(points.values)} set points every "
        f"{points.interval_ms:g} ms. Scale: {experiment.scale:g}.",
        "",
        "SAFETY",
        *_SAFETY,
        *points.format.notes,
        "",
        "CHECK (at the joint; torque at the motor)",
    )
    for row in points.rows:
        yield (
            f"joint {row.joint} {row.quantity}: {row.peak:.4g}, limit {row.limit:.4g} "
            f"{row.unit}, margin {row.margin:.3g} ({row.where})"
        )
    springs = simulated.elasticity
    yield from (
        f"Simulated with K = {_list(springs.K)} N·m/rad, D = {_list(springs.D)} N·m·s/rad, "
        f"Coulomb friction {_list(simulated.coulomb_Nm)} N·m,",
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
    return " ".join(printable(text).split())[:200] or "without a name"


def numbers(values: Floats, decimals: int) -> str:
    """Numbers with commas between."""
    return ", ".join(f"{value:.{decimals}f}" for value in values.tolist())
