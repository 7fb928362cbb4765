"""Two identifications compared: before and after a gear is replaced, cold and warm, two estimators."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, Self, TypeVar

import numpy as np

from jointid.answer import StiffnessUnit
from jointid.errors import JointIdError
from jointid.estimation.quantities import Quantity
from jointid.wording import counted, enumerated, signed_percent, significant, with_error

_AT_MOTOR, _AT_JOINT = "N·m/rad at the motor", "N·m/rad at the joint"
CLEAR_SIGMAS = 3.0
"""Standard errors beyond which a difference is significant."""
INDEPENDENT_ERRORS = (
    f"Significant: beyond {CLEAR_SIGMAS:g} σ; σ is the standard error of the difference if both errors "
    "are independent. A common cause, such as a wrong torque constant of the same robot, changes both "
    "alike."
)
"""Explains ``significance``."""


@dataclass(frozen=True)
class Difference:
    """One parameter of two identifications."""

    first: Quantity
    second: Quantity
    relative: float
    """Second over first, less 1."""
    sigmas: float
    """Difference over its standard error; NaN where the two errors are not independent."""

    @property
    def is_clear(self) -> bool:
        """Whether the difference is significant."""
        return abs(self.sigmas) > CLEAR_SIGMAS

    @property
    def change(self) -> str:
        """The relative difference in per cent, with its standard error where it is not significant."""
        error = np.hypot(self.first.error, self.second.error) / np.abs(self.first.value or np.nan)
        if self.is_clear or not np.isfinite(self.sigmas * error):
            return signed_percent(100 * self.relative)
        return f"{with_error(100 * self.relative, 100 * error)} %"

    @property
    def significance(self) -> str:
        """Yes or no, with the size of the difference in standard errors."""
        if not np.isfinite(self.sigmas):
            return "–"
        size = f"{abs(self.sigmas):.1f} σ" if abs(self.sigmas) < 100 else "over 100 σ"
        return f"{'yes' if self.is_clear else 'no'}, {size}"


def compare(
    first: Sequence[Quantity], second: Sequence[Quantity], *, same_records: bool = False
) -> tuple[Difference, ...]:
    """Compare K and D of two identifications in the same unit, those that both have.

    The standard error of a difference takes both errors as independent. A common cause, such as the
    torque constant of the same robot, moves both alike and makes the stated number of standard errors
    too small. With ``same_records`` the noise is common, and no number of standard errors is stated.
    Returns K1 ... Kn, D1 ... Dn. Raises JointIdError when the numbers of joints differ.
    """
    _require_same_joints(first, second)
    found, others = [], {other.name: other for other in second}
    for one, other in ((one, others[one.name]) for one in first if one.name in others):
        error = float(np.hypot(one.error, other.error))
        change = other.value - one.value
        sigmas = np.nan if same_records or error == 0 else change / error
        relative = change / one.value if one.value else np.nan
        found.append(Difference(one, other, relative, float(sigmas)))
    return tuple(found)


def _require_same_joints(first: Sequence[Quantity], second: Sequence[Quantity]) -> None:
    joints = [sum(q.parameter == "K" for q in found) for found in (first, second)]
    if joints[0] != joints[1]:
        raise JointIdError(
            f"The first study has {counted(joints[0], 'joint')}, the second "
            f"{counted(joints[1], 'joint')}: choose studies of the same joints."
        )


class Shown(Protocol):
    """An answer, of motors or of sensors behind the gears."""

    @property
    def unit(self) -> StiffnessUnit:
        """Unit and side of K and D."""

    @property
    def quantities(self) -> Sequence[Quantity]:
        """K1 ... Kn, and D1 ... Dn of motors."""

    @property
    def sensors(self) -> Any:
        """Answer of sensors behind the gears, in addition to that of the motors, or None."""

    def shown_in(self, name: str) -> Self:
        """Return the answer in a unit of ``STIFFNESS_UNITS``."""


Answers = TypeVar("Answers", bound=Shown)


def values_shown(found: Iterable[Quantity], *, usable: bool) -> list[str]:
    """Values ± errors of one side of a comparison; dashes where its answer is not usable."""
    return [quantity.shown[0] if usable else "–" for quantity in found]


def comparable(first: Answers, second: Answers) -> tuple[Answers, Answers]:
    """Return both answers of one kind and unit.

    Where one is of sensors behind the gears only, the other is of its sensors, too, if it has them. The
    unit is that of both, else N·m/rad at the motor, else at the joint.
    Raises JointIdError when the numbers of joints differ, or one is at the joint only and the other has
    no gear ratios.
    """
    _require_same_joints(first.quantities, second.quantities)
    if _has_damping(first) != _has_damping(second):
        first, second = first.sensors or first, second.sensors or second
    if (first.unit.side, first.unit.angle) == (second.unit.side, second.unit.angle):
        return first, second
    shown = first.shown_in(_AT_MOTOR), second.shown_in(_AT_MOTOR)
    if shown[0].unit.side == shown[1].unit.side:
        return shown
    return first.shown_in(_AT_JOINT), second.shown_in(_AT_JOINT)


def _has_damping(answer: Shown) -> bool:
    return any(q.parameter == "D" for q in answer.quantities)


def comparison_sentence(
    rows: Sequence[Difference], first: str, second: str, *, exact_torque_scales: bool
) -> str:
    """State which joints of the second study are softer or stiffer than those of the first.

    ``exact_torque_scales``: a study does not state the uncertainty of its torque constants.
    """
    clear = [row for row in rows if row.first.parameter == "K" and row.is_clear]
    if not clear:
        return f"No stiffness of {second} differs significantly from that of {first}"
    changes = enumerated([f"joint {row.first.name[1:]} is {_change(row)}" for row in clear])
    condition = ", if the torque scales are exact" if exact_torque_scales else ""
    return f"{second} compared with {first}: {changes} (significant){condition}"


def _change(row: Difference) -> str:
    ratio = 1 + row.relative
    if ratio >= 1.5:
        return f"{significant(ratio, 2)} times as stiff"
    return f"{significant(100 * abs(row.relative), 2)} % {'stiffer' if ratio > 1 else 'softer'}"
