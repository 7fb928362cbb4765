"""Model validation: prediction of the torques through the gears at frequencies left out of the fit."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.elasticity import ElasticityFit
from jointid.wording import counted

_BANDS = 20
"""Bands of frequencies into which the lines of motions are divided."""
_MOST_STEPS = 6
"""Steps of a fit, which starts at that of all frequencies."""
_SINGULAR = 1e12
"""Condition of the information from which it does not determine K and D."""


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
                raise JointIdError("A part of the frequencies does not determine K and D.")
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
            raise JointIdError("The noise of these records is not known well enough.") from error
        score[out] = (deviation.conj() * solved).real.sum(axis=1) / n
        relative[out] = np.linalg.norm(deviation, axis=1) / np.linalg.norm(equations.b[out], axis=1)
    if not (np.isfinite(score).all() and np.isfinite(relative).all()):
        raise JointIdError("The noise of these records is not known well enough.")
    return TorquePrediction(equations.omega / (2 * np.pi), relative, score)
