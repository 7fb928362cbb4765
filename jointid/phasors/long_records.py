"""Records larger than memory: read in parts, each fitted like a record, and combined."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from jointid.errors import JointIdError
from jointid.phasors.fitted_sine import SineFit
from jointid.records import SineRecord


@dataclass(frozen=True, eq=False)
class LongRecord(SineRecord):
    """A record of which only the beginning is in memory.

    Plots show the beginning; the fit reads all of it.
    """

    parts: Callable[[], Iterator[SineRecord]] = field(kw_only=True, repr=False)
    """Returns an iterator over the consecutive parts, each a SineRecord on the same clock."""
    samples_in_all: int = field(kw_only=True)
    """Number of samples in all parts."""
    fingerprint: Callable[[], str] = field(kw_only=True, repr=False)
    """Returns a digest of the source of the parts."""

    @property
    def samples(self) -> int:
        """Number of samples in all parts."""
        return self.samples_in_all


def joined(fits: Sequence[SineFit], samples: Sequence[int]) -> SineFit:
    """Return the fit of a record from the fits of its consecutive parts.

    Each part is weighted by its number of ``samples``; all are on one clock. The noise is the scatter of
    the blocks of all parts; if the parts differ by more, because of noise slower than a part, it is the
    scatter of the parts. Raises JointIdError when there is no part.
    """
    if not fits:
        raise JointIdError("The record has no samples after start_s: correct start_s.")
    if len(fits) == 1:
        return fits[0]
    weight = np.asarray(samples, float) / np.sum(samples)
    degrees_of_freedom = np.array([fit.degrees_of_freedom for fit in fits])
    harmonics = np.array([fit.harmonics for fit in fits])  # (p, H, 2n)
    mean = np.einsum("p,phc->hc", weight, harmonics)
    deviation = harmonics - mean
    fundamentals = np.array([fit.fundamental for fit in fits])
    fundamental = weight @ fundamentals
    # Within the parts the blocks scatter around their part; the parts scatter around the whole.
    count = degrees_of_freedom + 1
    within = np.einsum(
        "p,phij->hij", weight**2 * degrees_of_freedom / count, np.array([fit.covariance for fit in fits])
    )
    between = np.einsum("p,phi,phj->hij", weight**2 / count, deviation, deviation.conj())
    total, parts = int(count.sum()), len(fits)
    covariance, left = (within + between) * total / (total - 1), total - 1
    # Parts that differ by more than the scatter of their blocks show noise slower than a part.
    seen = parts / (parts - 1) * np.einsum("p,phi->hi", weight**2, np.abs(deviation) ** 2)
    expected = np.maximum(np.einsum("hii->hi", covariance).real, 1e-300)
    slow = seen > expected * (1 + 3 / np.sqrt(parts - 1))
    larger = np.sqrt(np.where(slow, seen / expected, 1.0))
    covariance = covariance * larger[:, :, None] * larger[:, None]
    left = parts - 1 if slow[0].any() else left
    middle = np.array([fit.middle_s for fit in fits])
    offset = np.array([fit.offset for fit in fits])
    middle_s = float(weight @ middle)
    place = weight * (middle - middle_s)
    return SineFit(
        fundamental=fundamental,
        harmonics=mean,
        offset=weight @ offset,
        drift=place @ offset / (place @ (middle - middle_s)),
        middle_s=middle_s,
        deviations=np.concatenate(
            [
                w * (fit.deviations + (y - fundamental) / len(fit.deviations))
                for w, y, fit in zip(weight, fundamentals, fits, strict=True)
            ]
        ),
        covariance=covariance,
        degrees_of_freedom=left,
    )
