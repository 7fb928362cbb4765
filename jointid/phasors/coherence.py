"""Coherence of torque and motion in a record of any motion, and the band that it proposes."""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d

from jointid.arrays import Floats, true_runs
from jointid.errors import JointIdError
from jointid.phasors.spectrum import evenly_sampled
from jointid.records import JointRecord

_SEGMENTS = 10
"""Lengths of a Welch segment in the record, at least; more for robots of many joints."""
_PER_JOINT = 4
_COHERENT = 0.8
"""Smallest coherence of the proposed band."""
_ABOVE_FLOOR = 10.0
"""Smallest power of the angle in the proposed band, over the noise floor at high frequencies."""
_SHARE = 1 / 300
"""Smallest power of the velocity per octave there, over its largest: friction adds some everywhere."""
_HIGHEST = 1 / 6
"""Top of the proposed band over the sample rate: images of a held torque grow with frequency."""
_GAP = 5
"""Lines over which coherence and power are smoothed by their median."""


class Coherence(NamedTuple):
    """Welch estimate over half-overlapping Hann segments of a record."""

    frequency_hz: Floats  # (f,)
    coherence: Floats  # (f, n), multiple coherence of each motor's acceleration with all torques
    above_floor: Floats  # (f, n), power of each motor's angle over its floor at high frequencies


def coherence(record: JointRecord) -> Coherence:
    """Return the share of each motor's motion that is linear in the torques of all motors.

    In closed loop the torque follows the encoder's noise as well, so that a high coherence means motion
    only where the angle is also above its noise floor. Raises JointIdError when the record is too short.
    """
    n, used = record.n, slice(record.start, None)
    parts = max(_SEGMENTS, _PER_JOINT * n)
    length = record.samples // parts
    if length < 16:
        raise JointIdError(
            f"{record.label or 'A record'} has {record.samples} samples: a coherence of {n} joints "
            f"needs {16 * parts}. Record longer."
        )
    columns = np.hstack([record.theta_rad[used], record.tau_Nm[used]])
    columns = evenly_sampled(record.time_s[used], columns)[1]
    # Second differences keep the slow motion out of the spectrum's far lines.
    signals = np.hstack([np.diff(columns[:, :n], 2, axis=0), columns[1:-1, n:]])
    starts = np.arange(0, len(signals) - length + 1, length // 2)
    pieces = np.stack([signals[s : s + length] for s in starts])
    pieces -= pieces.mean(axis=1, keepdims=True)
    lines = np.fft.rfft(pieces * np.hanning(length)[:, None], axis=1)[:, 2:-1]
    frequency = np.asarray(np.fft.rfftfreq(length, record.interval_s)[2:-1], float)
    lines = np.ascontiguousarray(lines.transpose(1, 2, 0))
    power = lines @ lines.conj().swapaxes(1, 2)
    qq = np.einsum("fjj->fj", power[:, :n, :n]).real
    cross, torque = power[:, :n, n:], power[:, n:, n:]
    least = 1e-12 * np.trace(torque, axis1=1, axis2=2).real + np.finfo(float).tiny
    torque = torque + least[:, None, None] * np.eye(n)
    explained = np.einsum("fij,fji->fi", cross, np.linalg.solve(torque, cross.conj().swapaxes(1, 2)))
    share = np.divide(explained.real, qq, out=np.zeros_like(qq), where=qq > 0)
    free = len(starts) / max(len(starts) - n, 1)  # n torques explain n of the segments by chance
    angle = qq / np.sin(np.pi * frequency * record.interval_s)[:, None] ** 4
    floor = np.median(angle[3 * len(angle) // 4 :], axis=0)
    above = np.divide(angle, floor, out=np.full_like(angle, np.inf), where=floor > 0)
    return Coherence(frequency, np.clip(1 - (1 - share) * free, 0.0, 1.0), above)


def coherent_band(record: JointRecord) -> tuple[float, float]:
    """Return the widest band, lowest and highest frequency in Hz, with usable motion of some joint.

    Raises JointIdError when no frequency is coherent, or the record is too short.
    """
    frequency, share, above = coherence(record)
    above = _smooth(above)
    octave = above * frequency[:, None] ** 3  # power of the velocity
    # Also next to a line that moves: a sweep starts slowly and ends soon.
    octave = maximum_filter1d(octave, _GAP, axis=0)
    moves = (above >= _ABOVE_FLOOR) & (octave >= _SHARE * octave.max(axis=0))
    usable = np.any((_smooth(share) >= _COHERENT) & moves, axis=1)
    usable &= frequency * record.interval_s <= _HIGHEST
    runs = [run for run in true_runs(np.asarray(usable)) if run[1] - run[0] >= _GAP]
    if not runs:
        best = int(np.argmax(share.max(axis=1)))
        raise JointIdError(
            f"{record.label or 'The record'}: torque and motion are not coherent over a band: their "
            f"coherence is {share[best].max():.2f} at most, at {frequency[best]:.3g} Hz, and "
            f"{_COHERENT:g} is needed at {_GAP} neighbouring lines, "
            f"{frequency[1] - frequency[0]:.2g} Hz apart, with a motion above the noise. "
            "Record longer or larger motions. If the coherence is near 0, torque and angle may belong "
            "to different motors."
        )
    first, last = max(runs, key=lambda run: frequency[run[1] - 1] / frequency[run[0]])
    return float(frequency[first]), float(frequency[last - 1])


def _smooth(values: Floats) -> Floats:
    """Running median over neighbouring lines, (f, n)."""
    padded = np.pad(values, ((_GAP // 2, _GAP // 2), (0, 0)), mode="edge")
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, _GAP, axis=0), axis=-1))
