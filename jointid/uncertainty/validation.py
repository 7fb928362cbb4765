"""Model validation: residuals, harmonics, nonlinearity, and prediction at frequencies left out."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from jointid.arrays import Complexes, Floats
from jointid.errors import JointIdError
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.estimators.parameters import EFFECTS, GEAR_LAWS
from jointid.phasors.extract import Phasors
from jointid.wording import counted

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
    """Logarithm of the stiffness at the largest deflection over that at the smallest, shape (n,): the
    stiffness is taken to follow a power of the deflection."""
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
    hertz = f"{phasors.omega[record] / (2 * np.pi):.3g} Hz"
    return (
        f"The records are explained almost as well by {' or '.join(rival_laws(fit))}. To decide, repeat "
        f'"{phasors.labels[record]}" ({hertz}) at half the amplitude.'
    )


def _same_motion(omega: Floats, deflection: Complexes) -> list[np.ndarray]:
    """Records of one frequency whose joints move in the same proportion, as groups of indices."""
    largest = np.abs(deflection).max(axis=0)
    shape = deflection / np.where(largest > 0, largest, 1.0)
    length = np.linalg.norm(shape, axis=1)
    found, order = [], np.argsort(omega, kind="stable")
    for same in np.split(order, np.flatnonzero(np.diff(omega[order]) > 1e-9 * omega[order[1:]]) + 1):
        groups: list[list[int]] = []
        for i in same.tolist():
            for group in groups:
                k = group[0]
                if np.abs(np.vdot(shape[k], shape[i])) > 0.97 * length[k] * length[i]:
                    group.append(i)
                    break
            else:
                groups.append([i])
        found += [np.array(group) for group in groups]
    return found


_BANDS = 20
"""Bands of frequencies into which the lines of motions are divided."""
_MOST_STEPS = 6
"""Steps of a fit, which starts at that of all frequencies."""
_SINGULAR = 1e12
"""Condition of the information from which it does not determine K and D."""
_UNCERTAIN_NOISE = "The noise of these records is not known well enough: record longer."


@dataclass(frozen=True, eq=False)
class TorquePrediction:
    """Torque through the gears at frequencies left out of the fit of K and D."""

    frequency_hz: Floats
    """Frequencies of the records, or of the lines of motions, shape (r,), Hz."""
    relative_error: Floats
    """|measured − predicted| over |measured|, norms over the joints, shape (r,)."""
    score: Floats
    """Squared deviation over its variance from noise, K and D, shape (r,); about 1."""

    @property
    def misfit(self) -> float:
        """Mean score: about 1 when the model holds and the noise is as stated."""
        return float(self.score.mean())


def predict_torques(fit: ElasticityFit, *, folds: int = 2) -> TorquePrediction:
    """Cross-validation: b of equation (8) from a, of sines and motions, in one pose or several.

    K and D are fitted to some bands of frequencies and predict the torques in the others: every
    ``folds``-th band is left out at a time, each once. Inertias, friction, delay and effects stay as
    fitted to all records. Raises JointIdError with fewer frequencies than twice the folds, without a
    noise level, or when the frequencies of a fold do not determine K and D.
    """
    equations, n = fit.equations, fit.n
    s = 1j * equations.omega[:, None]
    frequencies, rank = np.unique(equations.omega, return_inverse=True)
    count = frequencies.size
    if count < 2 * folds:
        raise JointIdError(f"{counted(count, 'frequency')}: each part needs at least two.")
    band = rank * min(count, _BANDS) // count
    size = np.maximum(np.abs(fit.estimate), 1e-12)

    def whitened(p: Floats, rows: np.ndarray) -> Floats:
        V = equations.residual_covariance(p[:n], p[n:])[rows]
        error = equations.residual(p[:n], p[n:])[rows, :, None]
        unit = np.linalg.solve(np.linalg.cholesky(V), error).ravel()
        return np.asarray(np.sqrt(2) * np.concatenate([unit.real, unit.imag]))

    score, relative = np.zeros(band.size), np.zeros(band.size)
    for fold in range(folds):
        out = band % folds == fold
        try:
            part = least_squares(
                whitened, fit.estimate, x_scale=size, args=(~out,), max_nfev=_MOST_STEPS
            )
            scaled = np.asarray(part.jac) * size
            information = scaled.T @ scaled
            if np.linalg.cond(information) > _SINGULAR:
                raise JointIdError("One part of the frequencies does not determine K and D.")
            covariance = np.linalg.inv(information) * np.outer(size, size)
            K, D = part.x[:n], part.x[n:]
            a = equations.a[out, None]
            slope = np.concatenate([np.eye(n) * a, np.eye(n) * s[out, None] * a], axis=2)
            V = equations.residual_covariance(K, D)[out]
            V = fit.inflation * (V + slope @ covariance @ slope.conj().swapaxes(1, 2))
            deviation = equations.residual(K, D)[out]
            solved = np.linalg.solve(V, deviation[..., None])[..., 0]
        except JointIdError:
            raise
        except (ValueError, np.linalg.LinAlgError) as error:
            raise JointIdError(_UNCERTAIN_NOISE) from error
        score[out] = (deviation.conj() * solved).real.sum(axis=1) / n
        relative[out] = np.linalg.norm(deviation, axis=1) / np.linalg.norm(equations.b[out], axis=1)
    if not (np.isfinite(score).all() and np.isfinite(relative).all()):
        raise JointIdError(_UNCERTAIN_NOISE)
    return TorquePrediction(equations.omega / (2 * np.pi), relative, score)
