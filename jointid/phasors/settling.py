"""Settling test: does the first quarter of a record agree with its second half?"""

import numpy as np

from jointid.arrays import Complexes, Floats

FEWEST = 4
"""Blocks below which there is no test."""


def settling_change(local: Complexes, block: np.ndarray, count: np.ndarray) -> tuple[Floats, Floats]:
    """Change of a local phasor from the first quarter of the blocks to the second half.

    ``local``, shape (r, K, c), holds the phasor of each block of r records with c signals, less a level
    common to all blocks or not; entries beyond a record's blocks are ignored. ``block``, shape (K,), are
    the numbers of the blocks from 0, ``count``, shape (r, 1), how many each record has. Returns the
    magnitude of the change and its standard error, each (r, c), NaN with fewer than four blocks.
    """
    early = (block < count // 4)[..., None]
    late = ((block >= count // 2) & (block < count))[..., None]
    with np.errstate(divide="ignore", invalid="ignore"):
        n_early, n_late = early.sum(axis=1), late.sum(axis=1)
        first, second = (local * early).sum(axis=1) / n_early, (local * late).sum(axis=1) / n_late
        variance = (np.abs((local - second[:, None]) * late) ** 2).sum(axis=1) / (n_late - 1)
        noise = np.sqrt(variance * (1 / n_early + 1 / n_late))
    enough = count >= FEWEST
    return np.where(enough, np.abs(first - second), np.nan), np.where(enough, noise, np.nan)
