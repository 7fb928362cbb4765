"""Candidate models, and the comparison of their fits to the same data.

Models are compared by an information criterion with the cost over the best model's misfit, so that a
large misfit does not favour spurious parts; a part must also be significant and physical.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import chdtrc

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.estimators.maximum_likelihood import LikelihoodEstimate
from jointid.estimation.estimators.parameters import EFFECTS, FRICTION_EFFECTS, GEAR_LAWS
from jointid.motion.per_turn import PerTurn

EXPLAINED = 1.1
"""Misfit below which richer friction cannot improve the fit noticeably."""
NEEDED = 3.0
"""Ratio of misfits from which a part is needed, whatever its standard error."""
_SIGNIFICANT = 5.0
"""Standard errors by which an optional part must differ from zero."""
WORTH = 0.2
"""Share of the misfit beyond 1 that a part must explain where the residual exceeds the noise: any wrong
part explains a little."""
CHANCE = 1e-3
"""Probability of a misfit of the fundamentals, or of the score of any part, that leads to a richer model
on an ideal robot."""
_USUAL = 0.05
"""Probability of a misfit of the fundamentals above which no slow fit is needed."""
_BEND = 4.0
"""Largest ratio of two slopes of a gear; catalogues have up to 2."""
_MOST_RATIO_ERROR = 0.1
"""Largest change of a gear ratio over a turn by a transmission error; usual gears have up to 0.02."""
_DISSIPATIVE = 2.0
"""Standard errors by which Coulomb friction must be positive."""
_CERTAIN = 200.0
"""Wald statistic of a part from which a model without it need not be fitted."""


@dataclass(frozen=True)
class Model:
    """Parameters fitted in addition to K and D."""

    reversal: float | None
    """Velocity below which friction is free, over the record's largest; None: no friction."""
    delay: bool
    curve: bool = False
    """Whether friction has a part that varies nonlinearly with speed."""
    effects: tuple[str, ...] = ()
    """Keys of ``EFFECTS``, in its order."""
    differs: bool = False
    """Whether Coulomb and viscous friction differ between sines, or segments of motions."""
    per_turn: tuple[PerTurn, ...] = ()
    """Orders of the periodic effects, also of those that the model lacks."""

    @property
    def parts(self) -> tuple[str, ...]:
        """Parts of the model besides K and D: "friction", "delay", keys of ``EFFECTS``."""
        friction = ("friction",) if self.reversal is not None else ()
        return (*friction, *(("delay",) if self.delay else ()), *self.effects)

    @property
    def orders(self) -> list[int]:
        """Orders of its periodic effects."""
        return [k for each in self.per_turn if each.effect in self.effects for k in each.orders if k]

    def imitates_other_law(self, estimate: LikelihoodEstimate) -> bool:
        """Whether slopes begin with one near zero, as backlash, or with a steep one, as hysteresis."""
        if "piecewise" not in self.effects:
            return False
        p = estimate.named
        stiffer = (p.K + p["piecewise"]) / np.maximum(p.K, np.finfo(float).tiny)
        return bool(np.any((stiffer > _BEND) | (stiffer < 1 / _BEND)))

    def ratio_error(self, estimate: LikelihoodEstimate) -> Floats:
        """Largest change of each gear ratio by a transmission error, over the ratio, shape (n,)."""
        p = estimate.named
        amplitude = np.hypot(p["transmission"], p["transmission_quadrature"])
        orders = next(each.orders for each in self.per_turn if each.effect == "transmission")
        return np.asarray(amplitude * orders)

    @property
    def is_slow(self) -> bool:
        """Whether the model has a law of the gears."""
        return not set(GEAR_LAWS).isdisjoint(self.effects)

    def with_part(self, part: str) -> Model:
        """The model with one more part; friction and viscous friction alone replace each other."""
        if part == "friction":
            return replace(self.without("viscous"), reversal=0.0)
        if part == "delay":
            return replace(self, delay=True)
        base = self.without("friction") if part == "viscous" else self
        return replace(base, effects=tuple(e for e in EFFECTS if e in (*base.effects, part)))

    def replacing(self, part: str, other: str) -> Model:
        """The model with another part in place of one."""
        return self.without(part).with_part(other)

    def without(self, part: str) -> Model:
        """The model without one part."""
        if part == "friction":
            rest = tuple(e for e in self.effects if e not in FRICTION_EFFECTS)
            return replace(self, reversal=None, curve=False, differs=False, effects=rest)
        if part == "delay":
            return replace(self, delay=False)
        return replace(self, effects=tuple(e for e in self.effects if e != part))

    @property
    def name(self) -> str:
        """Description of the model."""
        changes = ["varies with speed"] * self.curve + ["differs from record to record"] * self.differs
        friction = ["friction" + " that " * bool(changes) + " and ".join(changes)]
        parts = ["elasticity"] + friction * (self.reversal is not None) + ["delay"] * self.delay
        orders = {each.effect: f" ({each.of_joints} per turn)" for each in self.per_turn}
        parts += [EFFECTS[name].name + orders.get(name, "") for name in self.effects]
        return " + ".join(parts) + (
            f", reversals free below {100 * self.reversal:g} %" if self.reversal else ""
        )


@dataclass(frozen=True)
class Candidate:
    """One model of the comparison."""

    name: str
    model: Model
    problem: str
    """Reason why it was not fitted; empty otherwise."""
    cost: float
    expected_cost: float
    parameters: int
    """Number of fitted real numbers, those of free friction included."""
    criterion: float
    """Information criterion, 2 · cost over the best model's misfit + penalty; the smallest is chosen.
    Infinite where the model was not fitted, a part of it is not significant, or other reversals of the
    friction explain the fundamentals."""
    chosen: bool
    parts: tuple[str, ...] = ()
    """Its parts besides K and D, see ``Model.parts``."""


@dataclass(frozen=True, eq=False)
class Choice:
    """The chosen model, its estimate, and all candidates."""

    model: Model
    estimate: LikelihoodEstimate | JointIdError
    """The error if no model could be fitted."""
    candidates: tuple[Candidate, ...]
    """Best first."""
    spread: Floats
    """Covariance of K1 ... Kn, D1 ... Dn by the choice between models, shape (2n, 2n)."""


def dissipates(estimate: LikelihoodEstimate) -> bool:
    """Whether the friction of an estimate dissipates energy: Coulomb friction, or viscous alone."""
    coulomb, viscous = (estimate.layout[name] for name in ("coulomb", "viscous"))
    ratio = estimate.p / np.sqrt(np.maximum(np.diag(estimate.covariance), np.finfo(float).tiny))
    return bool(np.any(ratio[coulomb] > _DISSIPATIVE) or np.any(ratio[viscous] > _SIGNIFICANT))


def _of_springs(estimate: LikelihoodEstimate) -> Floats:
    """Variances of K beside those by torque scales that are fitted, shape (n,).

    NaN if the torque scale is undetermined: the records then give ratios only.
    """
    C, own = estimate.covariance, np.arange(estimate.named.K.size)
    if "torque_scale" not in estimate.layout:
        return C[own, own]
    scale = np.arange(len(C))[estimate.layout["torque_scale"]]
    known = np.isfinite(C[own, own]) & np.isfinite(C[scale, scale])
    by_scale = np.divide(C[own, scale] ** 2, C[scale, scale], out=np.full(own.size, np.nan), where=known)
    return np.asarray(np.maximum(C[own, own] - by_scale, 0.0))


def fundamental_chance(estimate: LikelihoodEstimate) -> float:
    """Probability of a larger misfit of the fundamentals by noise; NaN without degrees of freedom."""
    misfit, freedom = estimate.fundamental
    return float(chdtrc(freedom, misfit * freedom))


@dataclass
class Fits:
    """Models that were fitted to the same data, with their estimates."""

    optional: tuple[str, ...]
    """Parts that a model may lack: "friction", "delay" and keys of ``EFFECTS``."""
    rows: int
    """Real equations of all records, joints and harmonics."""
    tried: dict[Model, LikelihoodEstimate | JointIdError] = field(default_factory=dict)
    levels: int = 0
    """Number of levels of friction, Coulomb and viscous, of all joints in all sines and segments."""

    def estimate(self, model: Model) -> LikelihoodEstimate | None:
        """Estimate of a model; None where it was not, or could not be, fitted."""
        found = self.tried.get(model)
        return found if isinstance(found, LikelihoodEstimate) else None

    def misfit(self, model: Model) -> float:
        """Misfit of a model; infinite where it was not, or could not be, fitted."""
        found = self.estimate(model)
        return found.misfit if found else np.inf

    @property
    def least_misfit(self) -> float:
        """Misfit of the model that is nearest to the data."""
        return min(map(self.misfit, self.tried), default=np.inf)

    def least(self, models: Sequence[Model] = ()) -> Model:
        """Model with the smallest criterion; models with parts that are not significant come last.

        By default of all models tried.
        """
        judged, plain = self.criterion(), self.criterion(judged=False)
        return min(models or self.tried, key=lambda model: (judged[model], plain[model]))

    def criterion(self, *, judged: bool = True) -> dict[Model, float]:
        """2·cost + the penalty of the parameters, with the cost over the best model's misfit.

        Schwarz's penalty ln(rows) for the parameters, Akaike's 2 for each degree of freedom of the free
        friction, and a prior probability of 1/k² of periodic effects with k periods per turn, as low
        orders are the usual ones. It is infinite if a part is not significant (``judged``), or if only
        a model with other friction reversals explains the fundamentals, which give K and D: noise in
        many harmonics hides the misfit of wrong reversals.
        """
        fitted = {m: e for m in self.tried if (e := self.estimate(m))}
        misfit = max(1.0, min((e.misfit for e in fitted.values()), default=1.0))
        criterion = dict.fromkeys(self.tried, np.inf)
        explained = {m.parts for m, e in fitted.items() if m.reversal and fundamental_chance(e) > _USUAL}
        for model, estimate in fitted.items():
            contradicted = model.parts in explained and fundamental_chance(estimate) < CHANCE
            if contradicted or (judged and not self._is_significant(model, estimate)):
                continue
            free = estimate.parameter_count - estimate.p.size
            fitted_numbers = estimate.p.size + self.levels * model.differs
            penalty = float(np.log(self.rows)) * fitted_numbers + 2 * free
            penalty += 4 * float(np.log(model.orders).sum())
            criterion[model] = 2 * estimate.whole_cost(misfit) + penalty
        return criterion

    def is_behind(self, narrow: Model, model: Model) -> bool:
        """Whether another model is better than ``narrow``, which lacks parts of the fitted ``model``.

        The cost of ``narrow`` is at least that of ``model``.
        """
        found, lost = self.estimate(model), set(model.parts).difference(narrow.parts)
        if found is None or "friction" in lost or set(narrow.parts).difference(model.parts):
            return False
        sizes = (len(EFFECTS[p].parameters) * found.named.K.size if p in EFFECTS else 1 for p in lost)
        saved = float(np.log(self.rows)) * sum(sizes)
        return self.criterion(judged=False)[model] - saved >= min(self.criterion().values())

    def is_explained(self, model: Model) -> bool:
        """Whether noise explains the residual of a model, at the fundamentals as well."""
        found = self.estimate(model)
        return bool(found and found.misfit <= EXPLAINED and fundamental_chance(found) > _USUAL)

    def is_certain(self, model: Model, part: str, least: float = _CERTAIN) -> bool:
        """Whether the cost without a part would be far higher, by the Wald statistic."""
        estimate = self.estimate(model)
        if estimate is None:
            return False
        every = np.arange(estimate.layout.size)[estimate.layout.of_part(part)]
        variance = np.diag(estimate.covariance)[every]
        place = every[(variance > 0) & np.isfinite(variance)]
        covariance = estimate.covariance[np.ix_(place, place)]
        sigma = np.sqrt(np.diag(covariance))
        size = estimate.p[place] / sigma
        inverse = np.linalg.pinv(covariance / sigma / sigma[:, None], hermitian=True)
        return bool(size @ inverse @ size > least * max(1.0, estimate.misfit))

    def _is_significant(self, model: Model, estimate: LikelihoodEstimate) -> bool:
        """Whether every optional part is needed, or significant and physical."""
        return all(
            self.part_is_significant(model, estimate, part)
            for part in model.parts
            if part in (*self.optional, "piecewise")
        )

    def part_is_significant(self, model: Model, estimate: LikelihoodEstimate, part: str) -> bool:
        """Whether a part is significant, by its standard error and, for effects, the likelihood ratio.

        Free friction absorbs many small effects that are not friction; this rejects them.
        """
        if part == "friction" and set(FRICTION_EFFECTS).intersection(model.effects):  # tested separately
            rest, known = estimate.layout["coulomb"], np.diag(estimate.covariance)
            level = estimate.p[rest] + estimate.named.effect("motor_presliding")
            return bool(np.all(level > -_SIGNIFICANT * np.sqrt(known[rest])))
        own = max(1.0, estimate.misfit)
        place = estimate.layout.of_part(part)
        size = estimate.p[place]
        sigma = np.sqrt(np.diag(estimate.covariance)[place] * own)
        clear = np.abs(size) > _SIGNIFICANT * sigma
        if part in GEAR_LAWS and own < NEEDED:  # a law that replaces the spring is wrong
            lost = _SIGNIFICANT * np.sqrt(_of_springs(estimate) * own) > estimate.named.K
            if np.any(lost[clear] if clear.any() else lost):
                return False
        simpler = self.estimate(model.without(part))
        beyond_noise = own > EXPLAINED and simpler is not None and part != "friction"
        if beyond_noise and simpler and simpler.misfit - own < WORTH * (simpler.misfit - 1):
            return False
        if simpler and part in EFFECTS:  # its standard error may come from an uncertain inertia
            least = _SIGNIFICANT**2 + size.size
            least *= 1 + estimate.repeated  # repeated errors favour any part
            clear[:] = 2 * (simpler.whole_cost(own) - estimate.whole_cost(own)) > least
        if part == "transmission" and np.any(model.ratio_error(estimate) > _MOST_RATIO_ERROR):
            return False
        if part == "piecewise" and model.imitates_other_law(estimate):
            return False
        if part in EFFECTS and EFFECTS[part].positive:
            if np.any(size < -_SIGNIFICANT * sigma):
                return False
            clear &= size > 0
        elif part == "friction" and model.curve:  # its parts are certain together, if not each
            return self.is_certain(model, part, _SIGNIFICANT**2 + size.size)
        elif part == "friction":
            if not dissipates(estimate):
                return False
            clear &= size > 0
        return bool(clear.any()) or (simpler is not None and simpler.misfit > NEEDED * own)

    def candidates(self, best: Model) -> tuple[Candidate, ...]:
        """All models, best first."""
        criterion = self.criterion()

        def described(model: Model) -> Candidate:
            fitted = self.estimate(model)
            return Candidate(
                name=model.name,
                model=model,
                problem="" if fitted else str(self.tried[model]),
                cost=fitted.cost if fitted else np.inf,
                expected_cost=fitted.expected_cost if fitted else 0.0,
                parameters=fitted.parameter_count if fitted else 0,
                criterion=criterion[model],
                chosen=fitted is not None and model == best,
                parts=model.parts,
            )

        return tuple(map(described, sorted(self.tried, key=lambda model: criterion[model])))
