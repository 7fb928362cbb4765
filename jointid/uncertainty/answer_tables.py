"""Tables of the answer: parts of the errors by cause, compared models, and inertias given and fitted."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from jointid.answer import AT_MOTOR, StiffnessUnit, elasticity_quantities
from jointid.arrays import Floats
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.parameters import PARAMETERS, ParameterLayout, elasticity_labels
from jointid.wording import (
    UNDETERMINED,
    capitalised,
    enumerated,
    minus,
    percent,
    plain,
    significant,
    with_error,
)

_PARTS = {
    "noise": ("noise", "use longer records or a larger motion"),
    "prior": (
        "inertias and torque scale",
        "enter more accurate inertias or torque constants, or add records with a known payload",
    ),
    "unseen": ("friction harmonics", "move the joints faster, so that friction matters less"),
    "choice": (
        "choice of model",
        "add records of other amplitudes and frequencies, which decide between the models",
    ),
}
"""Name of each part, and what reduces it; the fit holds it as ``noise_error`` and so on."""
_MEANING = {
    "friction harmonics": "allowance for the shape of friction beyond the fitted harmonics",
    "choice of model": "difference from models that fit about as well",
}


def error_parts(fit: ElasticityFit) -> dict[str, Floats]:
    """Return the parts of ``fit.standard_error`` by cause, each (2n,); their squares add up to its own.

    Parts that do not apply are zero.
    """
    return {key: np.zeros(2 * fit.n) + getattr(fit, f"{key}_error") for key in _PARTS}


def largest_part(fit: ElasticityFit) -> str:
    """Say which part makes the largest relative error, and what reduces that part."""
    parts, size = error_parts(fit), np.maximum(np.abs(fit.estimate), np.finfo(float).tiny)
    worst = int(np.argmax(fit.standard_error / size))
    main = max(parts, key=lambda key: float(parts[key][worst]))
    name, (part, remedy) = elasticity_labels(fit.n)[worst], _PARTS[main]
    if not np.isfinite(fit.standard_error[worst]):
        return f"{name} is {UNDETERMINED}: the findings name the record that is missing."
    return f"The largest error is that of {name}; its largest part comes from {part}: {remedy}."


def error_table(fit: ElasticityFit, unit: StiffnessUnit = AT_MOTOR) -> dict[str, list[str]]:
    """Columns of a table: the total standard error of K and D, and its parts.

    Parts that are zero throughout are left out; that with the largest share of an error comes first.
    """
    parts = [(_PARTS[key][0], error) for key, error in error_parts(fit).items() if np.any(error > 0)]
    total = fit.standard_error
    known = np.isfinite(total) & (total > 0)
    parts.sort(key=lambda part: -float(np.max(part[1][known] / total[known], initial=0.0)))
    columns = {"": [found.heading for found in elasticity_quantities(fit, unit)]}
    for name, error in (("total error", total), *parts):
        unknown = UNDETERMINED if error is total else "–"
        sizes = zip(unit.shown(error).tolist(), np.isinf(total), strict=True)
        columns[name] = [unknown if lost else significant(size, 2) for size, lost in sizes]
    return columns


def parts_meaning(table: Iterable[str]) -> str:
    """Explain those columns of ``error_table`` that need it."""
    found = [f"{capitalised(name)}: {_MEANING[name]}." for name in table if name in _MEANING]
    return " ".join(found)


COMPARED_MODELS = (
    "Fitted models compared. The smallest information criterion is chosen: the residual plus a penalty "
    "for every parameter. A dash: the fit failed, a part of the model is not significant, or its "
    "friction at the reversals contradicts the fundamentals. Reversals free below 3 %: a motor may "
    "stick around a reversal, so below 3 % of the largest speed its friction is a free "
    "waveform in place of a model; the values of this waveform count as parameters. Friction that "
    "differs from record to record: every record has levels of Coulomb and viscous friction of its own."
)
"""Explains ``compared_models``."""


def compared_models(fit: ElasticityFit) -> dict[str, list[str]]:
    """Columns of a table: the models that were fitted, best first."""
    columns: dict[str, list[str]] = {
        "Fitted model": [c.name + " (chosen)" * c.chosen for c in fit.candidates],
        "Parameters": ["–" if c.problem else str(c.parameters) for c in fit.candidates],
    }
    misfits = [c.cost / c.expected_cost if c.expected_cost > 0 else np.inf for c in fit.candidates]
    criteria = np.array([c.criterion for c in fit.candidates])
    for name, values, digits in (
        ("Residual / noise", np.sqrt(misfits), 3),
        ("Criterion", criteria, 5),
    ):
        columns[name] = [significant(x, digits) if np.isfinite(x) else "–" for x in values.tolist()]
    return columns


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
        size = abs(self.given)
        std = percent(self.given_std / size) if size else significant(self.given_std, 2)
        given = f"{plain(self.given)} ± {std}"
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


def estimates_table(
    fits: Iterable[ElasticityFit], nominal: Floats | None, unit: StiffnessUnit
) -> dict[str, list[str]]:
    """Return K, D ± standard error in ``unit`` and residual of each estimator, and nominal, (2n,)."""
    by_method = {fit.method: fit for fit in fits}
    last = [] if nominal is None else ["nominal"]
    columns = {"Estimator": [*by_method, *last]}
    found = [elasticity_quantities(fit, unit) for fit in by_method.values()]
    for k, same in enumerate(zip(*found, strict=True)):
        given = [] if nominal is None else [plain(float(f"{nominal[k]:.5g}"))]
        columns[same[0].heading] = [*(each.shown[0] for each in same), *given]
    residuals = [significant(float(np.sqrt(fit.misfit)), 2) for fit in by_method.values()]
    return columns | {"Residual / noise": residuals + ["–" for _ in last]}
