"""Settling test: does the first quarter of a record agree with its second half?"""

import numpy as np

from jointid.arrays import Complexes, Floats

FEWEST = 4
"""Blocks below which there is no test."""


def settling_change(local: Complexes) -> tuple[Floats, Floats]:
    """Change of a local phasor from the first quarter of a record's blocks to the second half.

    ``local``, shape (K, c), holds the phasors of c signals in each block, less a level common to all
    blocks or not. Returns the magnitude of the change and its standard error, each (c,), NaN with fewer
    than four blocks.
    """
    if len(local) < FEWEST:
        unknown: Floats = np.full(local.shape[1], np.nan)
        return unknown, unknown
    early, late = local[: len(local) // 4], local[len(local) // 2 :]
    variance = late.var(axis=0, ddof=1) * (1 / len(early) + 1 / len(late))
    return np.abs(early.mean(axis=0) - late.mean(axis=0)), np.asarray(np.sqrt(variance))
