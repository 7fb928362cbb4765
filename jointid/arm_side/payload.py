"""The payload from the motor torques: a prior for the deflection's equations."""

import numpy as np

from jointid.arm_side.band_limited import BandLimited
from jointid.arm_side.mixed_model import Regression, low_frequency_noise
from jointid.arm_side.terms import waves
from jointid.arrays import Floats

_SCALE_STD = 0.3
"""Spread of the torque constant and of the gear's efficiency."""
_ROTOR_STD = 0.1
"""Relative standard deviation of the rotors' inertia."""
_GRAVITY_STD = 0.03
"""Standard deviation of the links' gravity torque, in parts of the joint's largest torque."""
_SLIP = 0.1
"""Lowest velocity, in parts of a joint's largest, at which its friction has a sign."""
_MEMORY_S = 0.5
_ROUNDS = 3


def payload_from_motors(
    motions: list[BandLimited],
    motor: list[Floats],
    rotor: list[Floats],
    torque: list[Floats],
    payload: list[Floats],
) -> tuple[Floats, Floats]:
    """Mean (4,) and a root (4, 4) of the covariance of the payload's standardised parameters.

    Each joint's motor torque, without its rotor, is the torque of links and payload times a scale
    near 1, plus Coulomb, viscous and load-dependent friction. The rotor's torque and the links'
    gravity, a wave over the joint angle, are uncertain as well: neither may pass for a payload.

    Parameters
    ----------
    motions : list of BandLimited
    motor, rotor, torque : list of ndarray, shapes (N, n)
        Motor torque at the joint without the rotors', the rotors', and the model's, N·m.
    payload : list of ndarray, shape (N, n, 4)
        Change of the model's torque per standard deviation.
    """
    opinions: list[tuple[Floats, Floats]] = [(np.eye(4), np.zeros(4))]
    for j in range(motor[0].shape[1]):
        y, columns, spans = [], [], []
        gravity = _GRAVITY_STD * max(float(np.abs(model[:, j]).max()) for model in torque)
        for m, tau, spin, model, change in zip(motions, motor, rotor, torque, payload, strict=True):
            step = max(1, int(1 / (8 * m.lowpass.band_hz * m.lowpass.interval_s)))
            rows = np.arange(len(m.q))[m.inner][::step]
            rows = rows[np.abs(m.dq[rows, j]) > _SLIP * np.abs(m.dq[:, j]).max()]
            sign = m.lowpass(np.sign(m.dq[:, j]))[rows]  # reversals as wide as in the torque
            v, s = m.dq[rows, j], model[rows, j]
            y.append(tau[rows, j] - s)
            X = [change[rows, j].T, s, spin[rows, j], gravity * waves(m.q[rows, j], np.ones(1)).T]
            X += [sign, sign * np.abs(s), v, v * np.abs(v), np.ones(rows.size)]
            columns.append(np.vstack(X).T)
            spans.append(rows.size)
        data = Regression(np.concatenate(y), np.concatenate(columns))
        if data.y.size < 40:
            continue
        std = np.r_[np.ones(4), _SCALE_STD, _ROTOR_STD, 1.0, 1.0, np.full(5, np.inf)]
        std[np.linalg.norm(data.columns, axis=0) < 1e-9] = 0.0
        noise = float(data.y.std())
        lags = int(_MEMORY_S / (step * motions[0].lowpass.interval_s))
        for _ in range(_ROUNDS):
            fitted = data.estimate(noise, std)
            noise = low_frequency_noise(data.residual(fitted), list(np.cumsum(spans)[:-1]), lags, 10.0)
        fitted = data.estimate(noise, std)
        seen = std[:4] > 0
        information = np.zeros((4, 4))
        information[np.ix_(seen, seen)] = np.linalg.inv(fitted.covariance[:4, :4][np.ix_(seen, seen)])
        opinions.append((information - np.diag(seen * 1.0), information @ fitted.beta[:4]))
    information = np.sum([A for A, _ in opinions], axis=0)
    mean = np.asarray(np.linalg.solve(information, np.sum([b for _, b in opinions], axis=0)), float)
    # joints that contradict each other are all less certain than their noise (Birge's ratio)
    excess = sum(_distance(A, b, mean) for A, b in opinions[1:]) / max(1, 3 * (len(opinions) - 1) - 4)
    precision, right = opinions[0][0], opinions[0][1]
    for A, b in opinions[1:]:
        precision, right = precision + A / max(1.0, excess), right + b / max(1.0, excess)
    covariance = np.linalg.inv(precision)
    root = np.linalg.cholesky((covariance + covariance.T) / 2)
    return np.asarray(covariance @ right), np.asarray(root, float)


def _distance(information: Floats, right: Floats, mean: Floats) -> float:
    """Squared distance of a mean from one joint's own, in its standard deviations."""
    own = np.linalg.pinv(information, rcond=1e-6, hermitian=True) @ right
    return float((own - mean) @ information @ (own - mean))
