"""One study, one row: what its analysis says in a line of a table."""

from __future__ import annotations

import datetime
import math
from dataclasses import dataclass, field, fields
from typing import Any

from jointid.files.digest import study_digest
from jointid.study import Analysis
from jointid.version import __version__

REFUSED, TIME, MEMORY, CRASH, LOST, FAULT = "refused", "time", "memory", "crash", "lost", "fault"
"""Why a study has no answer: its files cannot be used; it took too long; too much memory; its process
ended; its workers were lost; a fault of this software."""
FAILURES = ("", REFUSED, TIME, MEMORY, CRASH, LOST, FAULT)
VERDICTS = ("", "good", "warning", "problem")
MAX_JOINTS = 64
"""Most joints of a row that is read."""
JOINTWISE = (
    "K", "K_error", "D", "D_error", "K_unseen", "D_unseen", "K_nominal", "D_nominal",
    "coulomb", "viscous",
)  # fmt: skip
"""Fields with a value for each joint."""

Numbers = tuple[float, ...]


@dataclass(frozen=True)
class Row:
    """The answer for one study of n joints, or why there is none; motor side, SI units."""

    study: str
    """Path of the study, or the name of the file it came in."""
    content: str
    """Digest of its files; empty when they could not be read."""
    method: str
    """Estimator asked for, one of ``jointid.estimation.elasticity.METHODS``."""
    version: str
    """Version of this software."""
    time_s: float
    """How long reading and analysing took, s."""
    error: str = ""
    """Why there is no answer; empty when there is one."""
    failure: str = ""
    """The kind of error: "refused", "time", "memory", "crash", "lost", "fault", or empty."""
    digest: str = ""
    """Digest of the study as loaded, see ``jointid.files.digest``."""
    name: str = ""
    robot: str = ""
    date: str = ""
    """When it was measured, ISO 8601 as the study says it; empty when it does not say."""
    origin: str = ""
    joints: int = 0
    records: int = 0
    K: Numbers = ()
    """Stiffness, n values, N·m/rad."""
    D: Numbers = ()
    """Damping, n values, N·m·s/rad."""
    K_error: Numbers = ()
    """One standard error of K, N·m/rad."""
    D_error: Numbers = ()
    """One standard error of D, N·m·s/rad."""
    K_unseen: Numbers = ()
    """The part of ``K_error`` that no noise makes, N·m/rad."""
    D_unseen: Numbers = ()
    """The part of ``D_error`` that no noise makes, N·m·s/rad."""
    K_nominal: Numbers = ()
    """What the controller assumes; empty when the study does not say."""
    D_nominal: Numbers = ()
    coulomb: Numbers = ()
    """Coulomb friction, n values, N·m; empty when none was fitted."""
    viscous: Numbers = ()
    """Viscous friction, n values, N·m·s/rad; empty when none was fitted."""
    delay_s: float | None = None
    """Lag of the torque beyond what the records state, when it was fitted."""
    delay_error_s: float | None = None
    model: str = ""
    """What was fitted, in words."""
    misfit: float | None = None
    """What the equations leave over what the noise explains, about 1 when the model holds."""
    verdict: str = ""
    """Level of the most important finding: "good", "warning" or "problem"."""
    findings: tuple[str, ...] = field(default=())
    """Level and title of each finding, most important first."""

    @property
    def is_good(self) -> bool:
        """Whether there is an answer."""
        return not self.failure

    @property
    def is_final(self) -> bool:
        """Whether the same files would give the same row again: time, memory and luck play no part."""
        return self.failure in ("", REFUSED)


def row_of(
    analysis: Analysis, *, study: str, content: str = "", method: str = "auto", time_s: float = 0.0
) -> Row:
    """Return the row of an analysis, its numbers to the last bit.

    Parameters
    ----------
    analysis : Analysis
    study : str
        Path, or name of the file.
    content : str
        Digest of the study's files, see ``jointid.fleet.content``.
    method : str
        Estimator that was asked for.
    time_s : float
        How long it took, s.
    """
    fit, known = analysis.fit, analysis.study
    n = fit.n
    error = fit.standard_error
    unseen = [float(x) for x in (fit.unseen_error + 0.0 * error)]
    friction, nominal = fit.friction, known.nominal
    parts = ["elasticity"] + ["friction"] * (friction is not None) + ["delay"] * (fit.delay is not None)
    return Row(
        study=study,
        content=content,
        method=method,
        version=__version__,
        time_s=time_s,
        digest=study_digest(known),
        name=known.name,
        robot=known.robot,
        date="" if known.date is None else known.date.isoformat(),
        origin=known.origin,
        joints=n,
        records=len(known.records),
        K=_numbers(fit.K),
        D=_numbers(fit.D),
        K_error=_numbers(error[:n]),
        D_error=_numbers(error[n:]),
        K_unseen=_numbers(unseen[:n]),
        D_unseen=_numbers(unseen[n:]),
        K_nominal=() if nominal is None else _numbers(nominal.K),
        D_nominal=() if nominal is None else _numbers(nominal.D),
        coulomb=() if friction is None else _numbers(friction.coulomb),
        viscous=() if friction is None else _numbers(friction.viscous),
        delay_s=fit.delay,
        delay_error_s=fit.delay_error,
        model=" + ".join(parts),
        misfit=float(fit.misfit),
        verdict=analysis.findings[0].level,
        findings=tuple(f"{f.level}: {f.title}" for f in analysis.findings),
    )


def failed(
    study: str, method: str, failure: str, error: str, *, content: str = "", time_s: float = 0.0
) -> Row:
    """Return the row of a study without an answer."""
    return Row(study, content, method, __version__, time_s, error, failure)


def to_plain(row: Row) -> dict[str, Any]:
    """Return a row as JSON can hold it."""
    return {f.name: getattr(row, f.name) for f in fields(Row)}


def from_plain(document: Any) -> Row:
    """Return the row that ``to_plain`` was given.

    Raises
    ------
    TypeError
        When it is no object, or a field is unknown or missing.
    """
    if not isinstance(document, dict):
        raise TypeError(f"{document!r:.60} is no row")
    plain: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in document.items()}
    return Row(**plain)


def checked(row: Row) -> Row:
    """Return the row if a batch could have written it.

    Raises
    ------
    ValueError
        When a field is of another kind, or what it says cannot be.
    """
    for f in fields(Row):
        value = getattr(row, f.name)
        if not _is_of_kind(str(f.type), value):
            raise ValueError(f"{f.name} = {value!r:.60}")
    if not 0 <= row.joints <= MAX_JOINTS:
        raise ValueError(f"joints = {row.joints}")
    if row.verdict not in VERDICTS or row.failure not in FAILURES:
        raise ValueError("an unknown verdict or failure")
    if row.date:
        datetime.datetime.fromisoformat(row.date)
    if not math.isfinite(row.time_s):
        raise ValueError(f"time_s = {row.time_s}")
    for name in JOINTWISE:
        values = getattr(row, name)
        if len(values) not in (0, row.joints):
            raise ValueError(f"{name} = {values!r:.60} for {row.joints} joints")
        if name.endswith("_error") and any(value < 0 for value in values):
            raise ValueError(f"{name} = {values!r:.60}")
    return row


def _is_of_kind(kind: str, value: object) -> bool:
    """Whether a value is what the field's annotation says."""
    if kind.startswith("tuple") or kind == "Numbers":
        inner = "float" if kind == "Numbers" else "str"
        return isinstance(value, tuple) and all(_is_of_kind(inner, item) for item in value)
    if kind == "str" and isinstance(value, str):
        value.encode("utf-8", "surrogateescape")  # what is left over no table can hold
        return True
    if kind == "float | None":
        return value is None or isinstance(value, float)
    return type(value) is int if kind == "int" else kind == "float" and isinstance(value, float)


def _numbers(values: Any) -> Numbers:
    return tuple(float(value) for value in values)
