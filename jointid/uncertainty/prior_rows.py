"""Inertias and torque scales as given and as fitted, side by side."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointid.arrays import Floats
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.parameters import PARAMETERS, ParameterLayout
from jointid.wording import enumerated, minus, plain, significant, with_error


@dataclass(frozen=True)
class PriorRow:
    """One inertia or torque scale."""

    name: str
    """J_m1 (rotor), J_a1 (arm), J_12 (coupling) or torque scale 1; with the pose if it has its own.

    "J_a1 without addition" is the uncertain rest of an inertia with an exactly known part.
    """
    unit: str
    given: float
    given_std: float
    """Standard deviation of the given value: 0 exact, inf unknown."""
    fitted: float
    fitted_std: float
    """Its standard error, inf if nothing determines it; ``given_std`` if it was not fitted."""
    is_fitted: bool
    """False where the estimator keeps the given value."""

    @property
    def disagreement(self) -> float | None:
        """Fitted minus given value in standard deviations of the less certain; None without any."""
        known = self.is_fitted and 0 < self.given_std < np.inf and np.isfinite(self.fitted_std)
        return (self.fitted - self.given) / max(self.given_std, self.fitted_std) if known else None

    @property
    def cells(self) -> list[str]:
        """Name, given value, fitted value, unit and disagreement as texts."""
        given = f"{plain(self.given)} ± {significant(self.given_std, 2)}"
        if self.given_std == 0:
            given = f"{plain(self.given)} (exact)"
        elif np.isinf(self.given_std):
            given = f"{significant(self.given, 3)} (start value)"
        fitted = with_error(self.fitted, self.fitted_std) if self.is_fitted else "as given"
        distance = self.disagreement
        shown = "–" if distance is None else minus(f"{distance:+.1f} σ")
        if distance is not None and abs(distance) < 1:
            shown = "within 1 σ"
        return [self.name, given, fitted, self.unit, shown]


def prior_table(rows: Sequence[PriorRow]) -> dict[str, list[str]]:
    """Columns of a table by their heading; σ is the standard deviation of the less certain value."""
    header = ("", "given", "fitted", "unit", "fitted − given")
    return {name: [row.cells[k] for row in rows] for k, name in enumerate(header)}


def prior_rows(fit: ElasticityFit, poses: Sequence[str] = ()) -> tuple[PriorRow, ...]:
    """Return the uncertain inertias M and M2 of each pose, and the torque scales unless they are exact.

    ``poses`` holds the pose of each record, "" for none, to name the inertias; numbers by default.
    """
    prior = fit.prior
    priors = prior.blocks()
    given = {"M": prior.M, "M2": prior.lower, "torque_scale": np.ones(fit.n)}
    layout = ParameterLayout.of(
        fit.n, rotors=1, arms=1, torque_scale="torque_scale" in priors
    )  # labels of one pose
    rows = []
    for block in layout.blocks[2:]:
        mean = given[block.name].ravel()
        std = priors[block.name][1].ravel() if block.name in priors else np.zeros(mean.size)
        value, error = mean, std
        is_fitted = block.name in fit.parameters.layout
        if is_fitted:
            value = fit.parameters[block.name].ravel()
            error = fit.errors[block.name].ravel()
        columns = (column.tolist() for column in (mean, std, value, error))
        for k, (a, a_std, b, b_std) in enumerate(zip(*columns, strict=True)):
            pose, element = divmod(k, len(block.labels))
            name = block.labels[element] + _suffix(prior, block.name, pose, poses)
            rows.append(PriorRow(name, PARAMETERS[block.name].unit, a, a_std, b, b_std, is_fitted))
    return tuple(rows)


def disagreements(fit: ElasticityFit) -> Floats:
    """Disagreement of every fitted value with the given one, in standard deviations."""
    return np.array([abs(row.disagreement or 0.0) for row in prior_rows(fit)])


def _suffix(prior: InertiaPrior, block: str, index: int, poses: Sequence[str]) -> str:
    """Whether the inertia has a known part, and its poses unless it is that of all."""
    if block == "torque_scale":
        return ""
    part = prior.part[prior.pose]
    count, of_record = (len(prior.M), prior.rotor) if block == "M" else (len(prior.rest), part)
    loaded = block == "M2" and prior.added[prior.part == index].any()
    rest = " without addition" if loaded else ""
    if count == 1:
        return rest
    used = np.flatnonzero(of_record == index).tolist()
    names = dict.fromkeys(poses[r] for r in used) if poses else {f"{index + 1}": None}
    return f"{rest}, pose " + enumerated([name or "of [inertia]" for name in names])
