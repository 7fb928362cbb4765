"""Least-squares fit of a sine with harmonics, offset and drift to every channel of a record.

Uniform records use the two-level transform (``uniform_fit``), jittered or very short ones normal
equations at their sample times (``direct_fit``); records larger than memory are fitted in parts
(``long_records``).
"""

import math
from collections.abc import Sequence
from functools import lru_cache

from jointid.errors import JointIdError
from jointid.phasors.direct_fit import fit_directly
from jointid.phasors.fitted_sine import SineFit, Window
from jointid.phasors.long_records import LongRecord, joined
from jointid.phasors.uniform_fit import fit_uniformly
from jointid.records import SineRecord
from jointid.small_matrices import one_thread

FEWEST_BLOCKS = 8
"""With fewer blocks the residual, assumed white, gives the noise better than their scatter."""

FEWEST_SAMPLES = 8
"""Four unknowns per signal, and as many again for the noise."""

_BLOCK_SAMPLES = 1024
"""Shorter blocks make the call overhead of the matrix product dominate."""
_NEGLIGIBLE_PHASE = 1e-6
"""Phase error of jitter that does not show in a phasor, rad."""
_HIGHEST = 0.45
"""Highest harmonic over the sample rate."""


def fit_sines(records: Sequence[SineRecord], harmonics: int = 1) -> list[SineFit]:
    """Fit every record; uniform ones by the two-level transform, jittered or very short ones directly.

    ``harmonics`` is the highest in the fit. Excluded are those above 0.45 of the sample rate, and
    those that would make more unknowns than a quarter of the samples. Raises JointIdError when a record
    has fewer than ``FEWEST_SAMPLES`` usable samples.
    """
    with one_thread():
        return [_fit(record, harmonics) for record in records]


def _fit(record: SineRecord, harmonics: int) -> SineFit:
    if isinstance(record, LongRecord):
        parts = [(_fit(part, harmonics), part.samples) for part in record.parts()]
        return joined([fit for fit, _ in parts], [samples for _, samples in parts])
    window = _window(record, harmonics)
    enough = window.blocks >= FEWEST_BLOCKS
    if enough and is_uniform(record):
        return fit_uniformly(window, harmonics)
    return fit_directly(window, harmonics, by_scatter=enough)


def is_uniform(record: SineRecord) -> bool:
    """Whether the jitter is negligible for the record's phasors."""
    return record.jitter_s * record.omega < _NEGLIGIBLE_PHASE


def _window(record: SineRecord, harmonics: int) -> Window:
    samples = record.samples
    if samples < FEWEST_SAMPLES:
        raise JointIdError(
            f"{record.label or 'A record'} has {samples} usable samples; a sine with offset and trend "
            f"needs {FEWEST_SAMPLES}. Sample faster, or record longer."
        )
    orders, block = _layout(samples, 1 / (record.frequency_hz * record.interval_s), harmonics)
    return Window(record, orders, block, samples // block)


@lru_cache(maxsize=1024)
def _layout(samples: int, period: float, harmonics: int) -> tuple[int, int]:
    """Highest harmonic, and samples per block: a few periods of nearly a whole number of samples."""
    orders = max(1, int(min(_HIGHEST * period, samples / 8 - 1, harmonics)))
    if samples < 2 * period:  # within little more than a period, harmonics and drift are not separable
        orders = 1
    most = max(1, int(samples / period / (2 * FEWEST_BLOCKS)))
    least = min(most, math.ceil(_BLOCK_SAMPLES / period))
    lengths = [period * count for count in range(least, min(most, least + 7) + 1)]
    return orders, min((abs(length - round(length)), round(length)) for length in lengths)[1]
