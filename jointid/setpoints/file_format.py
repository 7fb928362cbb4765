"""Input and properties of a file format."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from jointid.arrays import Floats
from jointid.setpoints.experiment import Motion
from jointid.setpoints.limit_check import LimitRow, require_within_limits
from jointid.setpoints.robot_limits import RobotLimits

_ASCII = str.maketrans({"−": "-", "·": " ", "°": "deg", "²": "^2"})
"""Controllers may refuse other characters, in comments too."""


@dataclass(frozen=True, eq=False)
class SetPoints:
    """Set points of all m axes of a robot as they are written."""

    interval_ms: float
    values: Floats
    """In the unit of the format, rounded to its decimals, shape (N, m)."""
    motion: Motion
    """The motion of all axes from the start pose, rad and s, each (N, m)."""
    robot: RobotLimits
    rows: tuple[LimitRow, ...]
    """Check against the limits."""
    scale: float
    head: tuple[str, ...]
    """Lines about robot, check and safety."""
    write: Callable[[SetPoints], Iterator[str]]

    def text(self) -> str:
        """Return the file.

        Raises JointIdError when a limit is exceeded.
        """
        require_within_limits(self.rows, self.scale)
        return "\n".join([*self.write(self), ""])

    @property
    def comments(self) -> list[str]:
        """The head as comments in ASCII."""
        lines = (line.translate(_ASCII).encode("ascii", "replace").decode() for line in self.head)
        return [f"# {line}".rstrip() for line in lines]


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


def numbers(values: Floats, decimals: int) -> str:
    """Numbers with commas between."""
    return ", ".join(f"{value:.{decimals}f}" for value in values.tolist())
