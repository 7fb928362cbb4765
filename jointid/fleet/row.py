"""The row of a study in a fleet's table: its analysis in one line."""

import datetime
import math
from dataclasses import dataclass, field, fields
from typing import Any, TypeAlias

import numpy as np

from jointid.analysis import Analysis, ArmSideAnalysis, answer_state
from jointid.answer import model_name
from jointid.files.application import __version__
from jointid.files.digest import study_digest
from jointid.wording import counted

REFUSED, TIME, MEMORY, CRASH, LOST, FAULT = "refused", "time", "memory", "crash", "lost", "fault"
"""Reasons for a missing answer: unusable files; time limit; memory limit; its process ended; its workers
were lost; a fault of this software."""
FAILURES = ("", REFUSED, TIME, MEMORY, CRASH, LOST, FAULT)
VERDICTS = ("", "good", "warning", "problem")
MAX_JOINTS = 64
"""Most joints of a row read from a file; larger numbers are damage."""

Numbers: TypeAlias = tuple[float, ...]
"""A value for each joint."""


@dataclass(frozen=True)
class Row:
    """The answer for one study of n joints, or the reason for its failure; motor side, SI units.

    Where only sensors behind the gears give a usable K, it has no D, and K is NaN where it is refused.
    """

    study: str
    """Path of the study, or the name of the file it came in."""
    content: str
    """Digest of its files; empty when they could not be read."""
    method: str
    """Estimator asked for, one of ``jointid.estimation.identify_elasticity.METHODS``."""
    version: str
    """Version of this software."""
    time_s: float
    """Time of reading and analysis, s."""
    error: str = ""
    """Message of a failure; empty for an answer."""
    failure: str = ""
    """Kind of failure: "refused", "time", "memory", "crash", "lost", "fault", or empty."""
    digest: str = ""
    """Digest of the study as loaded, see ``jointid.files.digest``."""
    name: str = ""
    robot: str = ""
    date: str = ""
    """Date of the measurement, ISO 8601; empty when not stated."""
    origin: str = ""
    joints: int = 0
    records: int = 0
    K: Numbers = ()
    """Stiffness, n values, N·m/rad."""
    D: Numbers = ()
    """Damping, n values, N·m·s/rad."""
    K_error: Numbers = ()
    """One standard error of K, the whole one, N·m/rad; infinite where nothing determines it."""
    D_error: Numbers = ()
    """One standard error of D, N·m·s/rad."""
    K_nominal: Numbers = ()
    """Nominal values of the controller; empty when not stated."""
    D_nominal: Numbers = ()
    coulomb: Numbers = ()
    """Coulomb friction, n values, N·m; empty when none was fitted."""
    viscous: Numbers = ()
    """Viscous friction, n values, N·m·s/rad; empty when none was fitted."""
    delay_s: float | None = None
    """Fitted torque delay in addition to the stated one."""
    delay_error_s: float | None = None
    model: str = ""
    """Fitted model, as "elasticity + friction"."""
    misfit: float | None = None
    """Residual over the noise level (variances); about 1 when the model holds."""
    verdict: str = ""
    """Level of the most important finding: "good", "warning" or "problem"."""
    findings: tuple[str, ...] = field(default=())
    """Level and title of each finding, most important first."""

    @property
    def is_good(self) -> bool:
        """Whether there is an answer."""
        return not self.failure

    @property
    def state(self) -> str:
        """State of the answer, one of ``jointid.analysis.STATES``; empty without an answer."""
        return answer_state([self.verdict]) if self.is_good else ""

    @property
    def is_final(self) -> bool:
        """Whether the same files give the same row again, independent of time, memory and chance."""
        return self.failure in ("", REFUSED)


def row_of(
    analysis: Analysis | ArmSideAnalysis,
    *,
    study: str,
    content: str = "",
    method: str = "auto",
    time_s: float = 0.0,
) -> Row:
    """Return the row of an analysis, its numbers to the last bit.

    ``study`` is its path or the name of its file, ``content`` the digest of its files, ``method`` the
    requested estimator and ``time_s`` the time of reading and analysis.
    """
    known, nominal = analysis.study, analysis.study.nominal
    of_fit = _of_motors(analysis) if isinstance(analysis, Analysis) else _of_sensors(analysis)
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
        joints=known.inertia.n,
        records=len(known.records),
        K_nominal=() if nominal is None else _numbers(nominal.K),
        D_nominal=() if nominal is None else _numbers(nominal.D),
        model=model_name(analysis.fit),
        verdict=analysis.findings[0].level,
        findings=tuple(f"{f.level}: {f.title}" for f in analysis.findings),
        **of_fit,
    )


def _of_motors(analysis: Analysis) -> dict[str, Any]:
    fit, friction = analysis.fit, analysis.fit.friction
    return {
        "K": _numbers(fit.K),
        "D": _numbers(fit.D),
        "K_error": _numbers(fit.errors.K),
        "D_error": _numbers(fit.errors.D),
        "coulomb": () if friction is None else _numbers(friction.coulomb),
        "viscous": () if friction is None else _numbers(friction.viscous),
        "delay_s": fit.delay,
        "delay_error_s": fit.delay_error,
        "misfit": float(fit.misfit),
    }


def _of_sensors(analysis: ArmSideAnalysis) -> dict[str, Any]:
    """K seen from the motors, as in every row; NaN with an infinite error where it is refused."""
    at_motor = analysis.fit.robot.gear_ratio**-2.0
    error = np.where(np.isfinite(analysis.fit.K), at_motor * analysis.fit.standard_error, np.inf)
    return {"K": _numbers(at_motor * analysis.fit.K), "K_error": _numbers(error)}


def failed_row(
    study: str, method: str, failure: str, error: str, *, content: str = "", time_s: float = 0.0
) -> Row:
    """Return the row of a failed study."""
    return Row(study, content, method, __version__, time_s, error, failure)


def to_plain(row: Row) -> dict[str, Any]:
    """Return a row as plain values for JSON."""
    return {f.name: getattr(row, f.name) for f in fields(Row)}


def from_plain(document: Any) -> Row:
    """Return a row from the values of ``to_plain``.

    Raises AttributeError, TypeError or ValueError when they are no table, a field is unknown or missing,
    or its value is impossible.
    """
    values: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in document.items()}
    row = Row(**values)
    if not 0 <= row.joints <= MAX_JOINTS:
        raise ValueError(f"joints = {row.joints}")
    for name, value in vars(row).items():
        if isinstance(value, str):
            value.encode("utf-8", "surrogateescape")  # other surrogates have no UTF-8
        if isinstance(value, tuple) and name != "findings":
            negative = name.endswith("_error") and any(x < 0 for x in value)
            if len(value) not in (0, row.joints) or negative:
                raise ValueError(f"{name} = {value!r:.60} for {counted(row.joints, 'joint')}")
    if row.verdict not in VERDICTS or row.failure not in FAILURES:
        raise ValueError("an unknown verdict or failure")
    if row.date:
        datetime.datetime.fromisoformat(row.date)
    if not math.isfinite(row.time_s):
        raise ValueError(f"time_s = {row.time_s}")
    return row


def _numbers(values: Any) -> Numbers:
    return tuple(float(value) for value in values)
