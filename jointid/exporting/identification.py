"""The exported part of an analysis: K and D with their covariance, model, inertias and origin."""

from dataclasses import dataclass, field, replace

import numpy as np

from jointid.analysis import NOT_USABLE, STATES, Analysis
from jointid.answer import AT_MOTOR, effect_values, model_name
from jointid.arrays import Floats, finite_array, frozen
from jointid.errors import JointIdError
from jointid.estimation.elasticity import Friction
from jointid.estimation.identify_elasticity import require_method
from jointid.files.application import __version__
from jointid.files.digest import study_digest
from jointid.gears.gear import Gear
from jointid.joints import Elasticity, Inertia
from jointid.uncertainty.error_parts import error_parts
from jointid.uncertainty.prior_rows import PriorRow
from jointid.wording import counted


@dataclass(frozen=True)
class Obtained:
    """Version, settings and study digest: enough to reproduce K and D."""

    version: str
    """Version of this software."""
    digest: str
    """Fingerprint of the study to its last bit, see ``jointid.files.digest``."""
    study: str
    """Name of the study."""
    origin: str
    """"simulated", "measured", or empty when not stated."""
    method: str
    """Requested estimator, one of ``jointid.estimation.identify_elasticity.METHODS``."""
    model: str
    """Fitted model, see ``model_name``."""
    free_reversal: float
    """Share of the largest velocity below which friction is a free parameter."""
    records: int
    """Number of records."""
    frequencies_hz: tuple[float, ...]
    """Distinct frequencies, ascending, Hz."""
    misfit: float
    """Residual over the noise level (variances); about 1 when the model holds."""
    inertia_std: float = 0.0
    """Relative standard deviation of the given inertias; inf: unknown."""
    torque_std: float | None = None
    """The same of the torque constants; None: not stated."""
    changes: tuple[str, ...] = ()
    """Changes of the data as logged, see ``jointid.corrections``, oldest first."""


@dataclass(frozen=True, eq=False)
class Identification:
    """K and D of n joints with their model, for other tools; motor side.

    Raises JointIdError when shapes disagree or a value is not finite.
    """

    K: Floats
    """Stiffness, shape (n,), N·m/rad."""
    D: Floats
    """Damping, shape (n,), N·m·s/rad; may be negative."""
    covariance: Floats
    """Covariance of K1 ... Kn, D1 ... Dn, shape (2n, 2n): the total error.
    Undetermined parameters have an infinite variance and no covariance."""
    friction: Friction | None
    """Fitted friction of the motors, or None."""
    delay: float | None
    """Fitted torque delay in addition to the stated one, s, or None."""
    delay_error: float | None
    """Its standard error, s."""
    inertia: Inertia
    """Inertia of records without a pose, as fitted together with K and D; the given one if exact."""
    poses: dict[str, Inertia]
    """Inertia of each named pose, likewise."""
    nominal: Elasticity | None
    """Present values of the controller."""
    obtained: Obtained
    state: str = ""
    """State of the answer, one of ``jointid.analysis.STATES``; empty when not stated."""
    answer: str = ""
    """The answer as a sentence with what limits it; of an unusable one, the reason."""
    error_parts: dict[str, Floats] = field(default_factory=dict)
    """Parts of the standard errors by cause, each shape (2n,), see ``uncertainty.error_parts``."""
    effects: dict[str, tuple[Floats, Floats]] = field(default_factory=dict)
    """Values and standard errors of fitted effects, by names of their parameters."""
    priors: tuple[PriorRow, ...] = ()
    """Inertias and torque scales as given and as fitted."""
    gears: tuple[Gear, ...] = ()
    """Laws of the gears, n of them; empty when not stated."""

    def __post_init__(self) -> None:
        n = self.inertia.n
        checked: dict[str, object] = {name: _of_shape(name, getattr(self, name), (n,)) for name in "KD"}
        checked["covariance"] = _errors("covariance", self.covariance, (2 * n, 2 * n))
        checked["error_parts"] = {
            name: _errors(f"error_parts.{name}", error, (2 * n,))
            for name, error in self.error_parts.items()
        }
        checked["effects"] = {
            name: (_of_shape(name, values, (n,)), _errors(name, errors, (n,)))
            for name, (values, errors) in self.effects.items()
        }
        if self.friction is not None:
            checked["friction"] = Friction(
                _of_shape("friction.coulomb", self.friction.coulomb, (n,)),
                _of_shape("friction.viscous", self.friction.viscous, (n,)),
                _errors("friction.standard_error", self.friction.standard_error, (2 * n,)),
            )
        for name, value in checked.items():
            object.__setattr__(self, name, value)
        if self.state not in ("", *STATES):
            raise JointIdError(f'state = "{self.state:.60}": expected one of {", ".join(STATES)}.')
        for name in ("delay", "delay_error"):
            if getattr(self, name) is not None:
                finite_array(f"{name} (s)", getattr(self, name), ndim=0)
        for joints in [self.nominal, *self.poses.values()]:
            if joints is not None and joints.n != n:
                raise JointIdError(
                    f"The inertia has {counted(n, 'joint')}, nominal or a pose has {joints.n}."
                )
        if self.gears and len(self.gears) != n:
            raise JointIdError(f"gears: {counted(len(self.gears), 'gear')}; expected one per joint.")
        require_method(self.obtained.method)

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.inertia.n

    @property
    def is_usable(self) -> bool:
        """Whether files for controllers and simulators may hold its numbers."""
        return self.state != NOT_USABLE

    @property
    def standard_error(self) -> Floats:
        """Root of the covariance's diagonal, shape (2n,), order K1 ... Kn, D1 ... Dn."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))

    @property
    def elasticity(self) -> Elasticity:
        """K and D as a model; a damping that is negative within two standard errors counts as zero.

        Raises JointIdError when they are unphysical.
        """
        below_noise = self.D + 2 * self.standard_error[self.n :] < 0
        return Elasticity(K=self.K, D=np.where(below_noise, self.D, np.maximum(self.D, 0.0)))


def identification(analysis: Analysis) -> Identification:
    """Return the exported part of an analysis.

    Raises JointIdError when the fit holds a value that is not finite.
    """
    analysis = replace(analysis, unit=AT_MOTOR)  # as the numbers of the file
    fit, study = analysis.fit, analysis.study
    known = np.isfinite(fit.standard_error)
    return Identification(
        K=fit.K,
        D=fit.D,
        covariance=np.where(np.outer(known, known), fit.covariance, np.diag(np.where(known, 0, np.inf))),
        friction=fit.friction,
        delay=fit.delay,
        delay_error=fit.delay_error,
        inertia=analysis.inertia(),
        poses={pose: analysis.inertia(pose) for pose in study.poses},
        nominal=study.nominal,
        state=analysis.state,
        answer=" ".join(t for t in (analysis.headline, analysis.caution, *study.remarks) if t),
        error_parts={part.key: part.error for part in error_parts(fit)},
        effects=effect_values(fit),
        priors=analysis.priors,
        gears=fit.gears,
        obtained=Obtained(
            version=__version__,
            digest=study_digest(study),
            study=study.name,
            origin=study.origin,
            method=fit.method,
            model=model_name(fit),
            free_reversal=next((c.reversal for c in fit.candidates if c.chosen), 0.0),
            records=len(study.records),
            frequencies_hz=tuple(sorted({record.frequency_hz for record in study.sine_records})),
            misfit=fit.misfit,
            inertia_std=study.inertia_std,
            torque_std=study.torque_std,
            changes=study.changes,
        ),
    )


def _of_shape(name: str, value: Floats, shape: tuple[int, ...]) -> Floats:
    array = finite_array(name, value, ndim=len(shape))
    if array.shape != shape:
        raise JointIdError(f"{name} has shape {array.shape}; expected {shape}.")
    return array


def _errors(name: str, value: Floats, shape: tuple[int, ...]) -> Floats:
    """Errors of this shape; infinite where the records do not determine a value."""
    infinite = np.isposinf(np.asarray(value, float))
    return frozen(np.where(infinite, np.inf, _of_shape(name, np.where(infinite, 0.0, value), shape)))
