"""Model validation: residuals, harmonics, nonlinearity."""

from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.errors import JointIdError
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.estimators.parameters import EFFECTS, GEAR_LAWS
from jointid.phasors.extract import Phasors

_DEFLECTION_RATIO = 1.3
"""Smallest ratio of deflections of the records compared for a nonlinear stiffness."""
_DOUBT = 10.0
"""Difference of the criterion up to which a model is a rival of the chosen one."""


@dataclass(frozen=True, eq=False)
class RecordResiduals:
    """Residuals by record."""

    labels: tuple[str, ...]
    frequency_hz: Floats
    """Shape (r,), Hz."""
    normalised: Floats
    """Residual torque over its standard deviation from noise, shape (r, n); rms about 1."""

    @property
    def worst(self) -> tuple[int, int]:
        """Record and joint of the largest normalised residual."""
        record, joint = np.unravel_index(np.argmax(self.normalised), self.normalised.shape)
        return int(record), int(joint)


def record_residuals(phasors: Phasors, fit: ElasticityFit) -> RecordResiduals:
    """Residuals of each record in units of noise."""
    with np.errstate(divide="ignore", invalid="ignore"):
        normalised = np.nan_to_num(np.abs(fit.residual) / fit.residual_noise)
    return RecordResiduals(phasors.labels, phasors.omega / (2 * np.pi), normalised)


@dataclass(frozen=True, eq=False)
class HarmonicContent:
    """Harmonics of the excitation frequency; zero for linear joints."""

    odd: Floats
    """Amplitude of the odd harmonics from the third on over the fundamental, shape (r, 2n)."""
    even: Floats
    """The same for the even harmonics."""
    significance: Floats
    """Root mean square of the harmonics in units of their noise, shape (r, 2n); about 1 for noise."""


def harmonic_content(phasors: Phasors) -> HarmonicContent:
    """Distortion of angle and torque; odd for friction, even for asymmetric load or backlash.

    Raises JointIdError when the phasors were extracted without harmonics.
    """
    above = phasors.harmonics[:, 1:]
    if above.shape[1] < 2:
        raise JointIdError("These phasors have no harmonics: extract them with harmonics=3 or more.")
    known = np.any(above != 0, axis=2)
    variance = np.abs(np.einsum("rhjj->rhj", phasors.harmonic_covariance[:, 1:]))
    with np.errstate(divide="ignore", invalid="ignore"):
        size = np.abs(phasors.harmonics[:, 0])
        odd = np.linalg.norm(above[:, 1::2], axis=1) / size
        even = np.linalg.norm(above[:, ::2], axis=1) / size
        squares = np.where(known[..., None], np.abs(above) ** 2 / variance, 0.0)
        significance = np.sqrt(squares.sum(axis=1) / known.sum(axis=1)[:, None])
    return HarmonicContent(*(np.nan_to_num(x) for x in (odd, even, significance)))


@dataclass(frozen=True, eq=False)
class AmplitudeDependence:
    """Change of the stiffness with the deflection, at frequencies with several amplitudes."""

    deflection_rad: Floats
    """Smallest and largest deflection amplitude compared, shape (n, 2), rad; NaN without any."""
    change: Floats
    """Relative change of stiffness from the smallest to the largest deflection, shape (n,)."""
    standard_error: Floats
    """Standard error of ``change``, shape (n,); inf where no frequency has several amplitudes."""


def amplitude_dependence(fit: ElasticityFit) -> AmplitudeDependence:
    """Regress each record's stiffness on the logarithm of its deflection.

    Only records of one frequency in which the joints move in the same proportion are compared: others
    may differ for other reasons.
    """
    equations, n = fit.equations, fit.n
    K = equations.stiffness.real
    deflection = np.abs(equations.deflection)
    with np.errstate(all="ignore"):
        variance = 0.5 * (fit.residual_noise / deflection) ** 2
    ends = np.full((n, 2), np.nan)
    change, error = np.zeros(n), np.full(n, np.inf)
    groups = _same_motion(equations.omega, equations.deflection)
    for j in range(n):
        numerator, information, squares, degrees_of_freedom, used = 0.0, 0.0, 0.0, -1, []
        for group in groups:
            rows = group[np.isfinite(variance[group, j])]
            if rows.size < 2 or np.ptp(np.log(deflection[rows, j])) < np.log(_DEFLECTION_RATIO):
                continue
            x, w = np.log(deflection[rows, j]), 1 / np.maximum(variance[rows, j], 1e-300)
            x = x - (w * x).sum() / w.sum()
            y = K[rows, j] - (w * K[rows, j]).sum() / w.sum()
            numerator += float((w * x * y).sum())
            information += float((w * x * x).sum())
            squares += float((w * y * y).sum())
            degrees_of_freedom += rows.size - 1
            used.extend(deflection[rows, j])
        if used:
            ends[j] = min(used), max(used)
            span = np.log(ends[j, 1] / ends[j, 0]) / fit.K[j]
            left = (squares - numerator**2 / information) / max(degrees_of_freedom, 1)
            change[j] = span * numerator / information
            error[j] = abs(span) * np.sqrt(max(1.0, left) / information)
    return AmplitudeDependence(ends, change, error)


def rival_laws(fit: ElasticityFit) -> tuple[str, ...]:
    """Laws of the gears that explain the records almost as well and are not in the fit, by name."""
    best = min((c.criterion for c in fit.candidates if c.chosen), default=0.0)
    near = [c.name for c in fit.candidates if c.criterion < best + _DOUBT]
    laws = {EFFECTS[law].name for law in GEAR_LAWS if law not in fit.parameters.layout}
    return tuple(sorted(law for law in laws if any(law in name for name in near)))


def second_amplitude_record(fit: ElasticityFit) -> int | None:
    """Return the record whose repetition at half its amplitude settles a doubt between laws, if any."""
    one_amplitude = np.isinf(amplitude_dependence(fit).standard_error).any()
    if not rival_laws(fit) or fit.phasors.motion.any() or not one_amplitude:
        return None
    torque = np.stack([curve.amplitude_Nm for curve in fit.torsion_curves], axis=1)
    return int((torque / torque.max(axis=0)).sum(axis=1).argmax())


def second_amplitude(fit: ElasticityFit) -> str:
    """Advise a record of another amplitude where it settles a doubt between laws of the gears, or ""."""
    record, phasors = second_amplitude_record(fit), fit.phasors
    if record is None:
        return ""
    return (
        f"The records are explained almost as well by {' or '.join(rival_laws(fit))}. To decide, repeat "
        f"{phasors.labels[record]} ({phasors.omega[record] / (2 * np.pi):.3g} Hz) at half the amplitude."
    )


def _same_motion(omega: Floats, deflection: Complexes) -> list[np.ndarray]:
    """Records of one frequency whose joints move in the same proportion, as groups of indices."""
    largest = np.abs(deflection).max(axis=0)
    shape = deflection / np.where(largest > 0, largest, 1.0)
    length = np.linalg.norm(shape, axis=1)
    groups: list[list[int]] = []
    for i in range(omega.size):
        for group in groups:
            k = group[0]
            along = np.abs(np.vdot(shape[k], shape[i])) > 0.97 * length[k] * length[i]
            if abs(omega[i] / omega[k] - 1) < 1e-9 and along:
                group.append(i)
                break
        else:
            groups.append([i])
    return [np.array(group) for group in groups]
