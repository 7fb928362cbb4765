"""Velocity of the motors at every sample, for friction."""

import numpy as np
from scipy.fft import next_fast_len
from scipy.ndimage import uniform_filter1d

from jointid.arrays import Floats

_LINES = 15
"""Lines over which the power of a spectrum is averaged."""
_NEAR_HZ = 5.0
"""Band over which the gain of the filter is averaged, Hz."""


def smooth_velocity(theta: Floats, interval_s: float, variance: Floats) -> tuple[Floats, Floats, Floats]:
    """Derivative of angles with white noise, by Wiener's filter.

    Of angles (n, N), rad, with a ``variance`` (n,) of the noise in each sample, rad². Returns velocity
    (n, N), its standard deviation (n,), both rad/s, and its blur (n,): velocity over half the jump of
    the acceleration, at the instant of the jump, s.
    """
    samples, N = theta.shape[1], next_fast_len(theta.shape[1] - 1) + 1
    # Reflected about its ends, the signal is periodic, with a continuous velocity; reflected farther
    # about the last sample, its length suits the Fourier transform.
    theta = np.concatenate([theta, 2 * theta[:, -1:] - theta[:, samples - N - 1 : -1][:, ::-1]], axis=1)
    line = np.linspace(0, 1, N)
    level = theta - theta[:, :1] - (theta[:, -1:] - theta[:, :1]) * line
    periodic = np.concatenate([level, -level[:, -2:0:-1]], axis=1)
    spectrum = np.fft.rfft(periodic, axis=1)
    omega = 2 * np.pi * np.fft.rfftfreq(periodic.shape[1], interval_s)
    power = uniform_filter1d(np.abs(spectrum) ** 2, _LINES, axis=1, mode="nearest")
    noise = variance[:, None] * periodic.shape[1]
    gain = np.where(power > 0, np.maximum(1 - 2 * noise / np.where(power > 0, power, 1.0), 0.0), 0.0)
    gain[:, -1] = 0.0
    mean = (theta[:, -1] - theta[:, 0]) / (interval_s * (N - 1))
    velocity = np.fft.irfft(1j * omega * gain * spectrum, periodic.shape[1], axis=1)[:, :N]
    left = 2 * variance * ((omega * gain) ** 2).sum(axis=1) / periodic.shape[1]
    # A velocity |t| becomes the mean of |t| over the filter's pulse response, at t = 0. Below the main
    # frequency, and between the lines of a periodic motion, the filter drops what is not there.
    main = np.argmax(omega**2 * power, axis=1)[:, None]
    near = round(2 * _NEAR_HZ * interval_s * N) + 1
    kept, whole = (
        uniform_filter1d(each, near, axis=1, mode="nearest") for each in (gain * power, power)
    )
    share = np.divide(kept, whole, out=np.zeros_like(whole), where=whole > 0)
    lost = np.where(np.arange(omega.size) < main, 0.0, 1 - share)[:, 1:]
    blur = 2 / np.pi * ((lost / omega[1:] ** 2).sum(axis=1) * omega[1] + 1 / omega[-1])
    return np.asarray(velocity + mean[:, None])[:, :samples], np.asarray(np.sqrt(left)), blur
