"""Direction in which the arms move in motion records, which their Coulomb friction follows."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.signal import lfilter

from jointid.arrays import Complexes, Floats
from jointid.motion.reversals import phasors_of_turns, reversals
from jointid.phasors.segment import Motors, Segment

_MARGIN = 4.0
"""Standard deviations of the motor's velocity within which that of the arm has no clear sign."""
_SLOW, _STATIONARY = 5e-3, 0.5
"""Share of the arm's largest velocity below which its sign is not clear, and the share with an unclear
sign from which it counts as stationary."""


def arm_directions(
    segments: Mapping[int, Segment], motors: Sequence[Motors], K: Floats, D: Floats
) -> dict[int, Complexes]:
    """Phasors of the sign of each arm's velocity, (highest, n), by the row of the segment.

    Those of an arm that stands still are zero. The arm moves like the motor less the deflection of the
    gear, K δ + D δ̇ = f, under the torque f that the balance at the motor leaves. ``motors`` has those of
    every row, K and D have shape (n,).
    """
    return {row: _directions(each, motors[row], K, D) for row, each in segments.items()}


def _directions(segment: Segment, motors: Motors, K: Floats, D: Floats) -> Complexes:
    T, found = segment.interval_s, np.zeros((segment.highest, K.size), complex)
    torque = segment.gear_torque(motors, np.sign(segment.velocity))
    for j in range(K.size):
        damped = 2 * abs(D[j]) / T
        delta = lfilter([1, 1], [K[j] + damped, K[j] - damped], torque[j] - torque[j, 0])
        velocity = segment.velocity[j] - np.gradient(delta) / T
        largest = float(np.abs(velocity).max())
        blur = max(_MARGIN * float(segment.velocity_noise[j]), _SLOW * largest)
        if blur < _STATIONARY * largest:
            turns = reversals(velocity, blur, 0.0, 0.0)
            found[:, j] = phasors_of_turns(*turns, segment.samples, segment.highest)
    return found
