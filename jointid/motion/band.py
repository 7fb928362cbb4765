"""The band of a motion: frequencies that motion and torque visibly have."""

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import uniform_filter1d

from jointid.arrays import Floats
from jointid.motion.sampling import UniformPart

_SHARE = 1 / 300
"""Power of the velocity per octave, over its largest, that belongs to the motion."""
_CLEAR = 30.0
"""Power of motion and torque over that of their noise."""
HIGHEST = 0.16
"""Largest frequency over the sample rate: above it the sampled motion is inaccurate."""
_CYCLES = 5.0
"""Cycles of the lowest frequency in the shortest part."""


def proposed_band(parts: Sequence[UniformPart], variance: Floats) -> tuple[float, float]:
    """Lowest and highest frequency with a motion and torque above the noise, Hz.

    The torque of a fast controller follows the noise of the angle: it alone shows no motion. ``parts``
    are those of one record, ``variance``, shape (2n,), that of the noise in each sample of angles and
    torques, rad² and (N·m)².
    """
    T = parts[0].interval_s
    samples = max(part.theta.shape[1] for part in parts)
    grid = np.geomspace(_CYCLES / (samples * T), HIGHEST / T, 400)
    n = variance.size // 2
    octave, torque = np.zeros((2, n, grid.size))
    for part in parts:
        f, power = part.power
        lines = max(3, round(0.5 * part.theta.shape[1] * T))
        motion, drive = uniform_filter1d(power, lines, axis=2, mode="nearest")
        for j in range(n):
            octave[j] += np.interp(grid, f, motion[j]) * grid / len(parts)
            torque[j] += np.interp(grid, f, drive[j]) / len(parts)
    noise = variance[:n, None] * (np.sin(2 * np.pi * grid * T) / T) ** 2 * grid
    least = np.maximum(_SHARE * octave.max(axis=1, keepdims=True), _CLEAR * noise)
    visible = (octave > least) & (torque > _CLEAR * variance[n:, None])
    used = np.flatnonzero(visible.any(axis=0))
    if not used.size:
        return float(grid[0]), float(grid[-1])
    return float(grid[used[0]]), float(grid[used[-1]])
