"""Any motion as phasors: a record is cut into segments, and each is a Fourier series over its length.

Equation (1) also holds for the Fourier integral over a finite time if a polynomial in iω with real
coefficients is added, from the difference of the states at both ends (Pintelon and Schoukens, System
Identification, 2nd ed. 2012, section 6.3.2). The estimators eliminate this polynomial. The bins are the
harmonics of a segment's length. Segments keep time and memory linear in the samples, and their scatter
checks the error bars.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.motion.band import HIGHEST, proposed_band
from jointid.motion.noise import repeated_variances, sensor_variances
from jointid.motion.sampling import UniformPart, name_of, parts_of_records
from jointid.motion.velocity import smooth_velocity
from jointid.phasors.extract import Phasors
from jointid.phasors.segment import Segment, bins_of
from jointid.phasors.sensor_steps import quantum, rounded_variance
from jointid.records import MotionRecord

_SEGMENT_S, _PERIODS = 2.5, 40.0
"""Least length of a segment, s, and in periods of the band's highest frequency."""
_CYCLES = 4.0
"""Cycles of the lowest frequency in a segment, where the record allows it."""
_MOST_EQUATIONS = 1600
"""Equations of many joints above which a segment is shorter: the time grows with their cube."""
_LEAST_BINS = 8
"""Bins of a segment below which the terms of its ends leave no equation."""
_LEAST_TORQUE_NOISE = 3e-3
"""Smallest start value of the torque's noise, over the torque."""
_ACCURACY = 1e-5
"""Error of the torque by sampling and by the truncated terms of the ends, over the torque."""
_EXACT = 1e4
"""Degrees of freedom of a covariance from many samples."""


def motion_phasors(
    records: Sequence[MotionRecord],
    M: Floats,
    widened: float = 1.0,
    most_hz: float = np.inf,
    parts: Sequence[list[UniformPart]] | None = None,
) -> Phasors:
    """Phasors of the segments of motion records.

    ``M``, shape (r, n), is the rotor inertia of each record, kg·m², to separate the noise of torque and
    angle. ``widened`` multiplies the highest frequency of bands that the records do not state, and
    ``most_hz`` limits it. ``parts`` are those of ``parts_of_records``, where they are known. Raises
    JointIdError when a record's clock is too uneven, or its band is empty.
    """
    found = []
    sampled = parts_of_records(records) if parts is None else parts
    for index, (record, own) in enumerate(zip(records, sampled, strict=True)):
        band, least_s, variance, limits = _band_and_noise(record, own, M[index], widened, most_hz)
        name = name_of(record, index)
        found += [
            _row(segment, samples, record, name, part.held)
            for part in own
            for segment, samples in _segments(part, band, least_s, variance, limits, record)
        ]
        if not any(row.segments[0].record == index for row in found if row.segments[0]):
            if len(own) > 1:
                longest_s = max(part.duration_s for part in own)
                raise JointIdError(
                    f"{name}: missing samples interrupt this record, and the longest part without a "
                    f"gap, {longest_s:.2g} s, is too short for a spectrum. Log without interruptions."
                )
            chosen, remedy = (
                (", chosen from its spectrum,", "set")
                if record.band_hz is None
                else (" of the study", "widen")
            )
            raise JointIdError(
                f"{name}: the band of {band[0]:.3g} to {band[1]:.3g} Hz{chosen} holds too few lines of "
                f"the spectrum. Record longer, or {remedy} band_hz."
            )
    return Phasors.joined(found)


def _band_and_noise(
    record: MotionRecord, parts: list[UniformPart], M: Floats, widened: float, most_hz: float
) -> tuple[tuple[float, float], float, Floats, Floats]:
    """Band, Hz; least length of a segment, s; and the noise."""
    variances_above = cache(lambda highest_hz: sensor_variances(parts, highest_hz, M))
    if record.band_hz is not None:
        return record.band_hz, _SEGMENT_S, *_noise(parts, *variances_above(record.band_hz[1]))
    variance = variances_above(0.25 / record.interval_s)[0].copy()
    variance[M.size :] = 0.0  # far above the band, noise of the angle exceeds that of the torque
    for _ in range(2):  # the band depends on the noise beyond it, and the reverse
        band = proposed_band(parts, variance)
        variance, _ = variances_above(band[1])
    lowest, highest = proposed_band(parts, variance)
    widened = widened if widened * highest < HIGHEST / record.interval_s else 1.0
    highest *= widened  # the motion, without its noise, may go on beyond the limit
    noise = _noise(parts, *variances_above(highest))
    return (lowest, min(highest, max(most_hz, 2 * lowest))), _SEGMENT_S / widened, *noise


def _noise(parts: list[UniformPart], variance: Floats, most: Floats) -> tuple[Floats, Floats]:
    """Variance of each sample (2n,), that of the torque a start value; and three further ones (3, n).

    These are the least and the most of the torque's, and the repeated part of the angle's. Beyond the
    band the noise of the angle, and friction, may hide that of the torque.
    """
    size = np.mean([(part.tau**2).mean(axis=1) for part in parts], axis=0)
    least = _LEAST_TORQUE_NOISE**2 * np.concatenate([np.zeros(size.size), size])
    variance = np.maximum(variance, least)
    return variance, np.stack([_ACCURACY**2 * size, most, repeated_variances(parts)])


def _segments(
    part: UniformPart,
    band: tuple[float, float],
    least_s: float,
    variance: Floats,
    limits: Floats,
    record: MotionRecord,
) -> list[tuple[Segment, Floats]]:
    """Segments of equal length, ``least_s`` or more, with their samples (2n, N).

    A fixed band is used to its lowest line.
    """
    (n, N), fixed = part.theta.shape, record.band_hz is not None
    samples = np.concatenate([part.theta, part.tau])
    velocity, noise, blur = smooth_velocity(part.theta, part.interval_s, variance[:n])
    steps = [quantum(theta) for theta in part.theta]
    duration_s = part.duration_s
    length = max(least_s, _PERIODS / band[1])
    shorter = max(_MOST_EQUATIONS / (2 * n * band[1]), _CYCLES / band[0], _PERIODS / band[1])
    if n > 2:
        length = min(length, shorter)
    if fixed:
        length = max(length, _CYCLES / max(band[0], _CYCLES / duration_s))
    count = max(1, round(duration_s / length))
    edges = np.linspace(0, N, count + 1).astype(int)
    found = []
    for begin, end in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        duration = (end - begin) * part.interval_s
        lowest = max(1 if fixed else round(_CYCLES), int(np.ceil(band[0] * duration)))
        highest = min(int(band[1] * duration), (end - begin - 1) // 2)
        if highest - lowest + 1 < _LEAST_BINS:
            continue
        segment = Segment(
            record=part.record,
            interval_s=part.interval_s,
            uniform_angle=part.theta,
            uniform_velocity=velocity,
            torque=part.tau,
            held=part.held,
            begin=begin,
            end=end,
            velocity_noise=noise,
            velocity_blur_s=blur,
            angle_variance=_line_variances(samples[:n, begin:end], steps, variance, highest),
            repeated_variance=limits[2],
            torque_variance=variance[n:],
            least_torque_variance=limits[0],
            most_torque_variance=limits[1],
            lowest=lowest,
            highest=highest,
        )
        found.append((segment, samples[:, begin:end]))
    return found


def _line_variances(angles: Floats, steps: Sequence[float], variance: Floats, highest: int) -> Floats:
    """Variance of each angle (n, N) at each line, times N/4, shape (highest, n)."""
    each = zip(angles, steps, variance, strict=False)
    return np.stack([rounded_variance(*own, highest) for own in each], axis=1)


def _row(segment: Segment, samples: Floats, record: MotionRecord, name: str, held: bool) -> Phasors:
    n, H, T = record.n, segment.highest, segment.interval_s
    z = bins_of(samples, H).T[None]
    s = 2j * np.pi * np.arange(1, H + 1) / segment.duration_s
    timing = np.exp(-s * record.torque_delay_s)
    if held:
        timing = timing * -np.expm1(-s * T) / (s * T)
    z[:, :, n:] *= timing[:, None]
    z[:, : segment.lowest - 1] = 0
    covariance = segment.covariance[None].astype(complex)
    covariance[..., n:, n:] *= (np.abs(timing) ** 2)[:, None, None]
    return Phasors(
        omega=np.array([2 * np.pi / segment.duration_s]),
        q=z[:, 0, :n],
        tau=z[:, 0, n:],
        covariance=covariance[:, 0],
        degrees_of_freedom=np.array([_EXACT]),
        duration_s=np.array([segment.duration_s]),
        harmonics=z,
        harmonic_covariance=covariance,
        labels=(name,),
        segments=(segment,),
        hold_s=np.array([T * held]),
        torque_delay_s=np.array([record.torque_delay_s]),
    )
