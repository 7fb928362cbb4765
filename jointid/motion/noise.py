"""Noise of the sensors from the spectrum beyond the motion's band.

A rotor under a held torque obeys (τ_k + τ_{k−1})/2 = M (θ_{k+1} − 2θ_k + θ_{k−1})/T² except for
spring torque and friction, which are small at high frequencies. The difference of both sides is noise:
that of the torque falls with frequency, that of the angle rises with its fourth power.
"""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import nnls

from jointid.arrays import Complexes, Floats
from jointid.motion.sampling import UniformPart, windowed_spectrum
from jointid.phasors.sensor_steps import quantum

_BANDS, _LINES = 24, 20
"""Bands over which the spectrum is averaged, and fewest lines of one for the noise of a log."""
BEYOND, _NYQUIST = 1.3, 0.9
"""Range of the search for noise: from this multiple of the band's end to this share of half the rate."""
_LATEST = 0.5
"""Share of half the sample rate at which the search begins at the latest."""
_REWEIGHTED = 10
_PERIODIC = 0.9
"""Correlation of a motion with itself one period later."""
_ALIKE = 1e-5
"""Insignificant difference of such correlations."""
_SURE = 3.0
"""Standard errors above its estimate that a variance may have."""
_LARGE = 0.1
"""Noise over the torque above which that of the logged torque is the limit: where an encoder rounds the
same way again and again, as at rest, the balance takes what it leaves for noise of the torque."""
_LEAST_POWER = 1e-60
"""Least power of a joint that moves, (N·m)²."""
_FLOOR = 1e-10
"""Smallest standard deviation, over the signal's largest value."""


def sensor_variances(
    parts: Sequence[UniformPart], highest_hz: float, M: Floats
) -> tuple[Floats, Floats]:
    """Variance of each sample of angles and torques (2n,), and the most that the torques' can be (n,).

    ``parts`` have the same sensors; ``highest_hz`` is the upper end of the motion's band, ``M``, shape
    (n,), the rotor inertias, kg·m².
    """
    n, spectra = M.size, [_spectra(part, highest_hz) for part in parts]
    variance, most = np.zeros(2 * n), np.zeros(n)
    for j in range(n):
        power = np.concatenate([_means(np.abs(A[j] - M[j] * B[j]) ** 2) for _, A, B in spectra])
        gains = np.concatenate(
            [[M[j] ** 2 * _means(position), _means(torque)] for (position, torque), _, _ in spectra],
            axis=1,
        )
        count = np.concatenate([_counts(A[j]) for _, A, _ in spectra])
        if power.max() > _LEAST_POWER:
            variance[[j, n + j]], error = _non_negative(gains.T, power, count)
            most[j] = variance[n + j] + _SURE * error[1]
            logged = np.concatenate([_means(np.abs(A[j]) ** 2) for _, A, _ in spectra])
            logged = logged / gains[1] * (1 + _SURE * np.sqrt(2 / count))
            large = _LARGE**2 * np.mean([(part.tau[j] ** 2).mean() for part in parts])
            variance[n + j] = min(variance[n + j], max(logged.min(), large))
        steps = [quantum(part.theta[j]) for part in parts]
        size = np.max([np.abs([part.theta[j], part.tau[j]]).max(axis=1) for part in parts], axis=0)
        variance[j] = max(variance[j], max(steps) ** 2 / 12, (_FLOOR * size[0]) ** 2)
        variance[n + j] = max(variance[n + j], (_FLOOR * size[1]) ** 2)
        most[j] = max(most[j], variance[n + j])
    return variance, most


def logged_noise(samples: Floats) -> Floats:
    """Estimate of the variance of white noise in samples (n, N), rather too large, shape (n,).

    It is the least mean power of neighbouring lines, with its uncertainty.
    """
    lines = np.abs(windowed_spectrum(samples, 1.0)[1][:, 1:]) ** 2
    bands = np.array_split(lines, max(1, min(_BANDS, lines.shape[1] // _LINES)), axis=1)
    most = [band.mean(axis=1) * (1 + _SURE * np.sqrt(2 / band.shape[1])) for band in bands]
    return np.asarray(np.min(most, axis=0))


def repeated_variances(parts: Sequence[UniformPart]) -> Floats:
    """Variance of each angle's samples that the periods share, times the further periods, shape (n,).

    In every period of a periodic motion the rounding of the encoder is the same: the errors of the
    periods add up.
    """
    each = [[_repeated_rounding(angle) for angle in part.theta] for part in parts]
    return np.asarray(np.max(each, axis=0))


def _repeated_rounding(theta: Floats) -> float:
    N, step = theta.size, quantum(theta)
    ramp = np.arange(N) - 0.5 * (N - 1)
    angle = theta - theta.mean() - ramp * (ramp @ theta / (ramp @ ramp))
    if step == 0 or not angle.any():
        return 0.0
    lags = np.arange(N // 2)
    count = N - lags
    # Two moments of the motion up to each lag before its end, and from each lag on; drift moves it all.
    first, second = (np.concatenate([[0.0], np.cumsum(power)]) for power in (angle, angle**2))
    products = np.fft.irfft(np.abs(np.fft.rfft(angle, 2 * N)) ** 2)[: lags.size]
    before, after = first[count], first[N] - first[lags]
    both = second[count] + second[N] - second[lags]
    apart = both - 2 * products - (after - before) ** 2 / count
    alike = 1 - apart / np.maximum(both - (before**2 + after**2) / count, np.finfo(float).tiny)
    beyond = np.flatnonzero(alike < _PERIODIC / 2)
    if not beyond.size:
        return 0.0
    alike[: beyond[0]] = 0.0
    if alike.max() < _PERIODIC:
        return 0.0
    least = alike.max() - 0.5 * max(1 - alike.max(), _ALIKE)
    period = int(np.argmax(alike >= least))  # the first of its multiples
    difference = theta[period:] - theta[:-period]
    repeats = step**2 / 12 - float(difference.var()) / 2
    return max(repeats, 0.0) * (N / period - 1)


def _spectra(part: UniformPart, highest_hz: float) -> tuple[tuple[Floats, Floats], Complexes, Complexes]:
    """Gains of both variances (f,), and the two sides of the rotor's balance (n, f) beyond the band."""
    T, (f, torque, bend) = part.interval_s, part.rotor_spectra
    half = 0.5 / T
    used = (f > min(BEYOND * highest_hz, _LATEST * half)) & (f < _NYQUIST * half)
    z = np.exp(2j * np.pi * f[used] * T)
    gains = np.abs(1 - z) ** 4 / T**4, np.abs(1 + z) ** 2 / 4 if part.held else np.ones(z.size)
    return gains, torque[:, used], bend[:, used]


def _means(values: Floats) -> Floats:
    """Means over neighbouring lines."""
    return np.array([part.mean() for part in np.array_split(values, min(_BANDS, values.size))])


def _counts(values: Complexes) -> Floats:
    """Number of lines in each mean."""
    return np.array([part.size for part in np.array_split(values, min(_BANDS, values.size))], float)


def _non_negative(gains: Floats, power: Floats, count: Floats) -> tuple[Floats, Floats]:
    """Two variances with power = gains · variances, and their standard errors, each shape (2,)."""
    weight = np.sqrt(count) / np.maximum(power, 1e-300)
    for _ in range(_REWEIGHTED):
        rows = gains * weight[:, None]
        size = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
        found = nnls(rows / size, power * weight)[0] / size
        weight = np.sqrt(count) / np.maximum(gains @ found, 1e-3 * power + 1e-300)
    # Neighbouring lines through a window are dependent: 2 lines count as one.
    spread = np.linalg.pinv(rows.T @ rows / np.outer(size, size)) / np.outer(size, size)
    return np.asarray(found), np.asarray(np.sqrt(2 * np.diag(spread)))
