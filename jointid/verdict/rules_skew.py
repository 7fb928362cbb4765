"""Rule of the verdict on joints whose samples are not of the same instants.

A joint that is logged late by t has its position and torque times e^{-st}: its own balance is unchanged,
and its coupling to the others has a wrong phase. One step of the fit shows the misfit for other times,
and a parabola through three of them the best time. In motions, the end terms of a segment absorb
the samples that so short a shift moves into and out of it.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.candidates import Model
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.maximum_likelihood import LikelihoodEstimate
from jointid.estimation.estimators.noise import Noise
from jointid.estimation.estimators.parameters import Parameters
from jointid.estimation.identify_motion import few_phasors
from jointid.estimation.model_fits import fit_model, freest, stepped
from jointid.estimation.motion_noise import noise_of_rows
from jointid.estimation.regression_start import regression_start
from jointid.phasors.extract import Phasors
from jointid.verdict.evidence import Change, Evidence, Finding, number, problem, times_noise
from jointid.verdict.scorer import corrected
from jointid.wording import enumerated, joints_text, with_error

_MOST_JOINTS = 4
"""Above, the fits take too long."""
_STEPS = 0.25 ** np.arange(4)
"""Samples from the middle of a parabola to its other points: the next one is nearer to the best time."""
_PROMISING = 0.5
"""Expected misfit over the present one up to which times are tried."""
_DOUBTFUL = 2.5
"""Misfit of the answer, and of the first fit, from which other times are tried."""
_BETTER, _EXPLAINED = 0.3, 2.0
"""Misfit over that as logged, and misfit, up to which the times are accepted."""
_CLEAR = 5.0
"""Standard errors by which the joints must be apart."""
_MOST = 20.0
"""Largest time in samples: beyond, the records are not of one run."""
_WHOLE = 0.05
"""Deviation from whole samples that a shift by whole samples may leave."""


def joints_apart(evidence: Evidence) -> Iterator[Finding]:
    """Some joints are logged later than others."""
    phasors, fit = evidence.phasors, evidence.fit
    is_far = not (np.all(fit.K > 0) and fit.misfit < _DOUBTFUL)
    prior = fit.prior
    if not 1 < phasors.n <= _MOST_JOINTS or not is_far or prior is None:
        return
    interval = float(np.median([record.interval_s for record in evidence.records]))
    found: Skew | None = None
    with suppress(JointIdError, np.linalg.LinAlgError):
        if evidence.has_motions:
            phasors, source = few_phasors(list(evidence.records), prior)
            prior = prior.of_rows(source)
        found = skew(phasors, prior, interval)
    if found is None:
        return
    late = (found.late_s - found.late_s.min()) / interval
    whose, rest = np.flatnonzero(late > _WHOLE), np.flatnonzero(late <= _WHOLE)
    names = joints_text([j + 1 for j in whose.tolist()])
    times = enumerated([number(1e3 * interval * late[j], 2) for j in whose])
    samples = enumerated([with_error(late[j], found.error_s / interval) for j in whose])
    shift = np.round(late)
    by_rows = bool(np.all(np.abs(late - shift) < _WHOLE))
    how = f"interpolate the columns of {names} at later times"
    if by_rows:
        rows = enumerated([f"{shift[j]:.0f}" for j in whose])
        how = f"move the columns of {names} up by {rows} {'row' if rows == '1' else 'rows'}"
    yield problem(
        f"Position and torque of {names} are logged {times} ms later than those of "
        f"{joints_text([j + 1 for j in rest.tolist()])}",
        f"The joints are {samples} sample intervals apart. With this correction, the residual falls "
        f"from {times_noise(found.before)} to {times_noise(found.after)}.",
        f"Log all joints at the same instants, or {how}.",
        0.0,
        "",
        *([Change("shift", values=tuple(shift.tolist()))] if by_rows else []),
    )


@dataclass(frozen=True, eq=False)
class Skew:
    """Times between the samples of the joints."""

    late_s: Floats
    """Of each joint relative to the first, shape (n,)."""
    error_s: float
    """Largest standard error."""
    before: float
    """Misfit of the records as logged."""
    after: float
    """Misfit with the times."""


def skew(phasors: Phasors, prior: InertiaPrior, interval_s: float) -> Skew | None:
    """Times by which the joints are logged apart, if these explain the records; else None.

    Motions are fitted without friction: with it, their noise follows from the residual, and contains
    the error of the times. Raises JointIdError where the first fit fails.
    """
    is_sine = not phasors.motion.any()
    model = freest(phasors, Model(None, delay=is_sine), ("friction",) * is_sine)
    trial = _Trial(phasors, prior, model)
    late, error = np.zeros(phasors.n), np.zeros(phasors.n)
    fit = trial.fit(late, regression_start(phasors, prior))
    before = fit.misfit
    if before < _DOUBTFUL:
        return None
    for step_s in interval_s * _STEPS:
        place, expected = late.copy(), np.inf
        for j in range(1, phasors.n):
            step = step_s * np.eye(phasors.n)[j]
            low, here, high = (trial.misfit(place + k * step, fit) for k in (-1, 0, 1))
            bend = low + high - 2 * here
            if not bend > 0:
                return None
            place[j] += 0.5 * step_s * (low - high) / bend
            expected = here - 0.125 * (low - high) ** 2 / bend
            error[j] = step_s * np.sqrt(2 / bend * fit.misfit / fit.cost)
        if np.abs(place).max() > _MOST * interval_s:
            break
        late = place
        if not expected < _PROMISING * fit.misfit:
            break
        fit = trial.fit(late, fit.named)
    is_clear = bool(np.any(np.abs(late[1:]) > _CLEAR * error[1:]))
    if not (is_clear and fit.misfit < min(_EXPLAINED, _BETTER * before)):
        return None
    return Skew(late, float(error.max()), before, fit.misfit)


@dataclass(frozen=True, eq=False)
class _Trial:
    """Fits of one model to records with the joints moved in time."""

    phasors: Phasors
    prior: InertiaPrior
    model: Model

    def _moved(self, late_s: Floats) -> tuple[Phasors, Noise]:
        moved = moved_in_time(self.phasors, late_s)
        return moved, noise_of_rows(moved, self.prior)

    def fit(self, late_s: Floats, start: Parameters) -> LikelihoodEstimate:
        moved, noise = self._moved(late_s)
        return fit_model(moved, self.prior, start, noise, self.model)

    def misfit(self, late_s: Floats, fit: LikelihoodEstimate) -> float:
        """Misfit one step from a fit of other times."""
        moved, noise = self._moved(late_s)
        return stepped(moved, self.prior, fit, noise, self.model)[1]


def moved_in_time(phasors: Phasors, late_s: Floats) -> Phasors:
    """Phasors of joints that are logged late by ``late_s``, shape (n,), at common instants."""
    orders = np.arange(1, phasors.harmonics.shape[1] + 1)
    s = 1j * phasors.omega[:, None, None] * orders[:, None]
    return corrected(phasors, np.exp(-s * np.tile(late_s, 2)))
