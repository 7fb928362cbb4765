"""Input of the verdict's rules, and the finding as their result."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Literal

import numpy as np

from jointid.arrays import Floats
from jointid.estimation.elasticity import ElasticityFit
from jointid.joints import Inertia
from jointid.phasors.extract import Phasors
from jointid.records import MotionRecord, SineRecord
from jointid.transfer_matrix import TransferMatrix
from jointid.wording import enumerated, minus, significant

Action = Literal["", "edit columns", "edit mapping", "edit runs", "edit inertias"]
"""Part of the import that a remedy edits; the app maps it to a page."""


Code = Literal["", "model limits"]
"""Identifier of a finding that other modules look up."""
ChangeKind = Literal[
    "start", "frequency", "leave out", "delay", "hold", "scale", "order", "shift", "inertias"
]


_MOST_TIMES = 1000.0
"""Multiple of the noise beyond which the number is meaningless: the records contain hardly any noise."""


@dataclass(frozen=True, eq=False)
class Change:
    """A change to the study that may remedy a finding; ``jointid.corrections`` makes it."""

    kind: ChangeKind
    records: tuple[int, ...] = ()
    """The sine records concerned, from 0; empty for all records."""
    values: tuple[float, ...] = ()
    """Seconds to add ("delay"), 1 or 0 ("hold"), logged over true angles,
    then torques ("scale"), column of each angle, then torque ("order"), samples by which each joint is
    late ("shift"), or the relative standard deviation to state, if any ("inertias")."""
    inertias: Mapping[str, Inertia] = field(default_factory=dict)
    """Fitted inertia of each pose ("inertias")."""


@dataclass(frozen=True)
class Finding:
    """One statement of the verdict on the data or the answer, with its figures and a remedy."""

    level: str
    """"problem" (the answer is not usable), "warning" (a doubt that the error bars may not include),
    "good" (no action needed; states what limits the accuracy) or "note" (the answer accounts for it)."""
    title: str
    """The finding as a short sentence."""
    detail: str
    """Figures, and where they apply."""
    remedy: str
    """Remedy; empty if no action is needed."""
    weight: float
    """Importance, for the order: from 100 for problems, from 10 for warnings, 5 for "good", from 0 for
    notes; plus the relative change in K or D, if known."""
    action: Action = ""
    """Part of the import that the remedy edits; empty if it edits the study's files only, or nothing."""
    changes: tuple[Change, ...] = field(default=(), compare=False)
    """Changes to the study that may remedy it, the most likely first."""
    code: Code = ""


@dataclass(frozen=True, eq=False)
class Evidence:
    """One analysis, as the rules see it."""

    records: tuple[SineRecord | MotionRecord, ...]
    inertias: Sequence[Inertia]
    """Inertia of each record."""
    phasors: Phasors
    fit: ElasticityFit
    """The chosen estimate."""
    transfer_matrices: Mapping[str, TransferMatrix]
    """By pose."""
    automatic: ElasticityFit | None = None
    """The fit of "auto", if it is known already."""

    @property
    def sines(self) -> tuple[SineRecord, ...]:
        """The sine records."""
        return tuple(record for record in self.records if isinstance(record, SineRecord))

    @property
    def has_motions(self) -> bool:
        """Whether some records are motions; their phasors have a row for each line."""
        return len(self.sines) < len(self.records)

    @property
    def poses(self) -> tuple[str, ...]:
        """Pose of each record, "" if it has none."""
        return tuple(record.pose or "" for record in self.records)

    @property
    def frequency_hz(self) -> Floats:
        """Frequency of each record, shape (r,)."""
        return np.asarray(self.phasors.omega / (2 * np.pi))

    def of_pose(self, pose: str) -> tuple[np.ndarray, Inertia]:
        """Indices of a pose's records, and its inertia."""
        index = np.array([i for i, name in enumerate(self.poses) if name == pose], int)
        return index, self.inertias[int(index[0])]


def _finding(
    level: str,
    least: float,
    most: float,
    title: str,
    detail: str,
    remedy: str,
    effect: float,
    action: Action = "",
    *changes: Change,
) -> Finding:
    effect = float(np.clip(np.nan_to_num(effect, nan=0.0, posinf=most), 0.0, most))
    return Finding(level, title, detail, remedy, least + effect, action, changes)


problem = partial(_finding, "problem", 100.0, 80.0)
"""Return a finding that makes the answer not usable."""
warning = partial(_finding, "warning", 10.0, 80.0)
"""Return a finding that changes the answer by ``effect``, relative, beyond the error bars."""
note = partial(_finding, "note", 0.0, 4.0)
"""Return a finding that the answer accounts for; otherwise it would change by ``effect``."""


def good(title: str, detail: str) -> Finding:
    """Return the finding that no action is needed."""
    return Finding("good", title, detail, "", 5.0)


def times_noise(misfit: float) -> str:
    """Format a misfit, a ratio of variances, as a multiple of the noise."""
    ratio = np.sqrt(misfit)
    size = f"over {_MOST_TIMES:.0f}" if ratio > _MOST_TIMES else significant(ratio, 2)
    return f"{size} × noise"


def number(value: float, digits: int = 3) -> str:
    """Format a number with a number of significant digits: 2200, 0.1, 5.4×10⁻⁵."""
    size = abs(value)
    if size == 0 or 1e-4 <= size < 1e5:
        text = np.format_float_positional(float(f"{value:.{digits}g}"), trim="-")
        return minus(text)
    return significant(value, digits)


def some(names: Sequence[str]) -> str:
    """List up to four names, else three and the number of the others; semicolons separate lists."""
    count = 4 if len(names) == 4 else 3
    shown, more = list(names[:count]), [f"{len(names) - count} more"] * (len(names) > count)
    if any("," in name or " and " in name for name in shown):
        shown = ["; ".join(shown)]
    return enumerated(shown + more)


def relative(change: Floats, p: Floats) -> Floats:
    """Return |change| over |p|; a thousand where p is zero."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.nan_to_num(np.abs(change / p), nan=0.0, posinf=1e3))
