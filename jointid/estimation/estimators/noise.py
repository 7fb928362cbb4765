"""Noise of the phasors for the estimators: the estimate of each record, shrunk towards a common model.

A covariance estimated from a few periods is inaccurate, and so are weights from it. The sensors are the
same in all records: in the residual r = τ − Z q the real motion and torque cancel, loop noise included,
and the sensor noise remains. The covariances V = E C Eᴴ with E = [−Z, I] of all records therefore follow
from 3n sensor variances: of each angle, and of each torque a constant one and one in proportion to its
amplitude squared. Each record's covariance is shrunk towards this model, by as much as the
scatter around it justifies (empirical Bayes; Smyth, Statistical Applications in Genetics and Molecular
Biology 3, 2004).
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, nnls
from scipy.special import polygamma

from jointid.arrays import Complexes, Floats
from jointid.joints import motor_impedance
from jointid.phasors.extract import Phasors

_FLOOR = 1e-9
"""Smallest standard deviation of a phasor, over the signal's largest: better than any sensor."""
_MOST_PRIOR, _LEAST_PRIOR = 1e3, 0.5
"""Range of the prior degrees of freedom; below it the records share no common noise."""
_REWEIGHTED = 8
"""Iterations of the relative weights of the sensor variances."""
_WEIGHTED = 4
"""Iterations of the weights of lines, each from the last variance of the torque."""
_LEAST_SHARE = 0.05
"""Smallest share of a line that the local polynomials leave; below it the line shows no noise."""
_DIFFERS = 20.0
"""Twice the logarithm of the likelihood ratio from which a record has a torque noise of its own."""
_NEGLIGIBLE = 1e-40
"""Variance, over the largest, of a record without motion."""


@dataclass(frozen=True, eq=False)
class Noise:
    """Covariance of z = [q; τ] at every harmonic, with its degrees of freedom."""

    covariance: Complexes
    """Shape (r, H, 2n, 2n)."""
    degrees_of_freedom: Floats
    """Degrees of freedom of each record's covariance, shape (r,)."""

    def select(self, rows: np.ndarray) -> "Noise":
        """Return the noise of some records."""
        return Noise(self.covariance[rows], self.degrees_of_freedom[rows])

    @property
    def inverse_bias(self) -> Floats:
        """Mean factor by which the inverse of an estimated n × n covariance is too large, (r,).

        ν/(ν − n) for a complex Wishart matrix of ν degrees of freedom.
        """
        n = self.covariance.shape[-1] / 2
        return np.asarray(self.degrees_of_freedom / (self.degrees_of_freedom - n))

    @property
    def weight_penalty(self) -> Floats:
        """Factor on the variance of a fit whose weights come from an estimated covariance, (r,).

        ν²/((ν − n)² − 1) for a complex Wishart matrix of ν degrees of freedom.
        """
        n = self.covariance.shape[-1] / 2
        return np.asarray(self.degrees_of_freedom**2 / ((self.degrees_of_freedom - n) ** 2 - 1))


def moderated_noise(phasors: Phasors, M: Floats, arm: Floats, K: Floats, D: Floats) -> Noise:
    """Noise of the records, each shrunk towards the model of common sensor variances.

    ``M``, shape (r, n), and ``arm``, shape (r, n, n), are the rotor inertias and M2⁻¹ of every record;
    ``K`` and ``D``, shape (n,), a first estimate, for the impedance Z.
    """
    _, H, channels = phasors.harmonics.shape
    n = phasors.n
    known = np.any(phasors.harmonics != 0, axis=2)
    s = np.asarray(1j * phasors.omega[:, None] * np.arange(1, H + 1))
    Z, _ = motor_impedance(s, M[:, None], arm[:, None], K, D)
    E = np.concatenate([-Z, np.broadcast_to(np.eye(n), Z.shape)], axis=3)
    rounding = phasors.harmonic_rounding[:, :H, :, None] * np.eye(channels)
    density = (phasors.harmonic_covariance - rounding) * phasors.duration_s[:, None, None, None]
    own = np.einsum("rhja,rhab,rhjb->rhj", E, density, E.conj()).real
    squares = np.abs(E) ** 2
    amplitude = phasors.torque_size / np.maximum(phasors.torque_size.max(axis=0), 1e-300)
    relative = squares[..., n:] * amplitude[:, None, None] ** 2
    gains = np.concatenate([squares, relative], axis=3)
    sensors = _sensor_variances(gains, np.where(known[..., None], own, 0.0))
    modelled = np.einsum("rhja,ha->rhj", gains, sensors)
    prior, scale = _prior_degrees_of_freedom(
        own[known], modelled[known], np.repeat(phasors.degrees_of_freedom, known.sum(axis=1))
    )
    variances = np.tile(scale * sensors[:, :channels], (len(E), 1, 1))
    variances[..., n:] += scale * sensors[:, channels:] * amplitude[:, None] ** 2
    total = phasors.degrees_of_freedom + prior
    share = (phasors.degrees_of_freedom / total)[:, None, None, None]
    density = share * density + (1 - share) * variances[..., None] * np.eye(channels)
    if total.min() <= n + 2:  # singular, or nearly
        density = density * np.eye(channels)
        total = np.maximum(total, n + 3.0)
    covariance = density / phasors.duration_s[:, None, None, None] + rounding
    return Noise(floored(covariance, phasors.z), total)


def floored(covariance: Complexes, z: Complexes) -> Complexes:
    """Covariance (r, H, 2n, 2n) with at least the variance of the best sensor of signals z (..., 2n)."""
    largest = np.abs(z).reshape(-1, z.shape[-1]).max(axis=0).reshape(2, -1)
    # A signal that is zero throughout gets the floor of the others of its kind.
    largest = np.where(largest > 0, largest, largest.max(axis=1, keepdims=True)).ravel()
    return np.asarray(covariance + np.diag((_FLOOR * largest) ** 2))


def sensor_noise(phasors: Phasors, left: Complexes, E: Complexes) -> dict[int, Floats]:
    """Variance of each sample of the torques (n,) in every motion record, by its number.

    In a few neighbouring lines, a part of the residual that is linear in the angles, with smooth
    coefficients, is no noise but an error of the model; a smooth part is that of the ends. Noise is the
    rest (local polynomial method; Pintelon and Schoukens, 2012, section 7.2). All records share it,
    unless the likelihood ratio shows that of a record to be its own: a slow one may hold an aliased
    torque. NaN where no line shows it. ``left``, shape (r, H, n), is the residual of a fitted model, NaN
    where free friction hides the noise; ``E``, shape (r, H, n, 2n), its derivative by the signals.
    """
    n = phasors.n
    width, joints = 3 * (2 * n + 2), range(n)
    place = np.linspace(-1, 1, width)[:, None]
    smooth = np.concatenate([np.ones((width, 1)), place], axis=1)
    blocks, records = [], []
    for row, segment in enumerate(phasors.segments):
        count = 0 if segment is None else (segment.highest - segment.lowest + 1) // width
        if segment is None or not count:
            continue
        used = slice(segment.lowest - 1, segment.lowest - 1 + count * width)
        q = phasors.harmonics[row, used, :n].reshape(count, width, n)
        local = np.concatenate([q, q * place, np.broadcast_to(smooth, (count, width, 2))], axis=2)
        gain = np.abs(E[row, used]) ** 2
        own = gain[:, joints, range(n, 2 * n)]
        known = (gain[..., :n] * segment.angle_variance[used, None]).sum(axis=2)
        lines = [np.sqrt(segment.samples) / 2 * left[row, used], own, known]
        blocks.append([local, *(each.reshape(count, width, n) for each in lines)])
        records += [segment.record] * count
    numbers = {segment.record for segment in phasors.segments if segment is not None}
    found = {number: np.full(n, np.nan) for number in numbers}
    if not blocks:
        return found
    local, *lines = (np.concatenate(each) for each in zip(*blocks, strict=True))
    local /= np.maximum(np.linalg.norm(local, axis=1, keepdims=True), 1e-300)
    for j in joints:
        of_joint = [each[..., j] for each in lines]
        seen = np.isfinite(of_joint[0]).all(axis=1)
        if seen.any():
            residual, own, known = (each[seen] for each in of_joint)
            of_blocks = np.array(records)[seen]
            variances = _torque_variances(local[seen], residual, own, known, of_blocks)
            for number in numbers:
                found[number][j] = variances.get(number, variances[None])
    return found


def _torque_variances(
    local: Complexes, residual: Complexes, own: Floats, known: Floats, records: np.ndarray
) -> dict[int | None, float]:
    """Variance of a torque, by record where a record has its own, and of all others by None.

    Lines of shape (blocks, width) with the gain ``own`` beside the variance ``known``; the columns
    ``local``, (blocks, width, c), are no noise. Weights keep noisy lines from spreading over others.
    """
    rows = {number: records == number for number in np.unique(records).tolist()}
    power, share = np.abs(residual) ** 2, np.ones(residual.shape)
    alone: dict[int, float] = {}
    for _ in range(_WEIGHTED):
        for number, of in rows.items():
            alone[number] = _further_variance(power[of], own[of], known[of], share[of])
        variance = known + own * np.array([alone[number] for number in records.tolist()])[:, None]
        weight = 1 / np.sqrt(np.maximum(variance, 1e-300))[..., None]
        basis, _ = np.linalg.qr(local * weight)
        rest = residual[..., None] * weight
        rest = rest - basis @ (basis.conj().swapaxes(1, 2) @ rest)
        share = np.maximum(1 - (np.abs(basis) ** 2).sum(axis=2), _LEAST_SHARE)
        power = variance * np.abs(rest[..., 0]) ** 2 / share
    found: dict[int | None, float] = {None: _further_variance(power, own, known, share)}
    for number, of in rows.items():
        mine = _further_variance(power[of], own[of], known[of], share[of])
        shared, better = (known[of] + v * own[of] for v in (found[None], mine))
        gain = power[of] * (1 / shared - 1 / better) + np.log(shared / better)
        if 2 * float((share[of] * gain).sum()) > _DIFFERS:
            found[number] = mine
    return found


def _further_variance(power: Floats, own: Floats, others: Floats, share: Floats) -> float:
    """Variance with the gain ``own`` beside ``others``, by maximum likelihood, from power.

    All of one shape; ``share`` is that of a line in the degrees of freedom.
    """
    if not power.size:
        return 0.0
    low = 1e-6 * float(np.median(power / own))
    found = max(float(np.median((power - others) / own)), low)
    for _ in range(_REWEIGHTED):  # the score of exponential powers, reweighted
        weight = share * (own / (others + found * own)) ** 2
        found = max(float((weight * (power - others) / own).sum() / weight.sum()), low)
    return found


def _sensor_variances(gains: Floats, variances: Floats) -> Floats:
    """Non-negative sensor variances (H, 2n) from gains (r, H, n, 2n) and variances (r, H, n)."""
    H, channels = gains.shape[1], gains.shape[3]
    rows = gains.swapaxes(0, 1).reshape(H, -1, channels)
    values = variances.swapaxes(0, 1).reshape(H, -1)
    use = values > _NEGLIGIBLE * values.max(axis=1, keepdims=True)
    weight = np.where(use, 1 / np.where(use, values, 1.0), 0.0)
    solution = np.zeros((H, channels))
    for _ in range(_REWEIGHTED):  # errors relative to the model are unbiased
        weighted = rows * weight[..., None]
        scale = 1 / np.maximum(np.linalg.norm(weighted, axis=1), 1e-300)
        weighted *= scale[:, None]
        solution = scale * _non_negative(weighted, values * weight)
        model = np.maximum(np.einsum("hmc,hc->hm", rows, solution), 1e-3 * values)
        weight = np.where(use, 1 / np.where(use, model, 1.0), 0.0)
    return solution


def _non_negative(A: Floats, b: Floats) -> Floats:
    """Least squares A x = b with x ≥ 0, for matrices (H, m, c) with columns of unit length."""
    normal = A.swapaxes(1, 2) @ A
    # A plain solution without negative values is the answer; the ridge is for columns of zeros.
    x = np.linalg.solve(normal + 1e-14 * np.eye(A.shape[2]), np.einsum("hmc,hm->hc", A, b)[..., None])
    solution = np.asarray(x[..., 0])
    for h in np.flatnonzero(np.any(solution < 0, axis=1)):
        solution[h] = nnls(A[h], b[h])[0]
    return solution


def _prior_degrees_of_freedom(
    own: Floats, modelled: Floats, degrees_of_freedom: Floats
) -> tuple[float, float]:
    """Prior degrees of freedom d of the model, and the factor that centres its variances.

    The variance of the log variances around the model is trigamma(d) plus that of their own estimation.
    """
    rows = np.all((own > 0) & (modelled > 0), axis=1)
    if rows.sum() < 3:
        return 0.0, 1.0
    own_degrees = degrees_of_freedom[rows, None]
    ratio = np.log(own[rows] / modelled[rows]) - (polygamma(0, own_degrees) - np.log(own_degrees))
    excess = (ratio**2 - polygamma(1, own_degrees)).mean()
    if excess <= polygamma(1, _MOST_PRIOR):
        return _MOST_PRIOR, 1.0
    if excess >= polygamma(1, _LEAST_PRIOR):
        return 0.0, 1.0
    prior = float(brentq(lambda d: polygamma(1, d) - excess, _LEAST_PRIOR, _MOST_PRIOR))
    return prior, float(np.exp(ratio.mean() + polygamma(0, prior) - np.log(prior)))
