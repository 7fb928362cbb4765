"""Records larger than memory: read in parts, each part fitted like a record, the fits joined."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from jointid.errors import JointIdError
from jointid.phasors.fitted_sine import SineFit
from jointid.records import SineRecord


@dataclass(frozen=True, eq=False)
class LongRecord(SineRecord):
    """A record of which only the beginning stands in memory.

    What is plotted of it, and what is judged by eye, is the beginning; the fit reads all of it.

    Parameters
    ----------
    parts : callable
        Returns an iterator over the consecutive parts, each a SineRecord on the same clock.
    samples_in_all : int
        Number of samples in all parts.
    fingerprint : callable
        Returns a digest of what the parts are read from.
    """

    parts: Callable[[], Iterator[SineRecord]] = field(kw_only=True, repr=False)
    samples_in_all: int = field(kw_only=True)
    fingerprint: Callable[[], str] = field(kw_only=True, repr=False)

    @property
    def samples(self) -> int:
        """Number of samples in all parts."""
        return self.samples_in_all


def joined(fits: Sequence[SineFit], samples: Sequence[int]) -> SineFit:
    """Return the fit of a record from the fits of its consecutive parts.

    Each part counts by its samples. The noise is what the blocks of all parts scatter by; where the
    parts differ by more, because noise is slower than a part, it is what the parts scatter by.

    Parameters
    ----------
    fits : sequence of SineFit
        On one clock, at least one.
    samples : sequence of int
        Samples of each part.

    Raises
    ------
    JointIdError
        When there is no part.
    """
    if not fits:
        raise JointIdError("The record has no samples after start_s: correct start_s.")
    if len(fits) == 1:
        return fits[0]
    weight = np.asarray(samples, float) / np.sum(samples)
    freedom = np.array([fit.freedom for fit in fits])
    harmonics = np.array([fit.harmonics for fit in fits])  # (p, H, 2n)
    mean = np.einsum("p,phc->hc", weight, harmonics)
    apart = harmonics - mean
    fundamentals = np.array([fit.fundamental for fit in fits])
    fundamental = weight @ fundamentals
    # Within the parts the blocks scatter around their part; the parts scatter around the whole.
    count = freedom + 1
    within = np.einsum(
        "p,phij->hij", weight**2 * freedom / count, np.array([fit.covariance for fit in fits])
    )
    between = np.einsum("p,phi,phj->hij", weight**2 / count, apart, apart.conj())
    total, parts = int(count.sum()), len(fits)
    covariance, left = (within + between) * total / (total - 1), total - 1
    # Where the parts differ by more than their blocks foretell, noise slower than a part is at work.
    seen = parts / (parts - 1) * np.einsum("p,phi->hi", weight**2, np.abs(apart) ** 2)
    told = np.maximum(np.einsum("hii->hi", covariance).real, 1e-300)
    slow = seen > told * (1 + 3 / np.sqrt(parts - 1))
    larger = np.sqrt(np.where(slow, seen / told, 1.0))
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
        freedom=left,
    )
