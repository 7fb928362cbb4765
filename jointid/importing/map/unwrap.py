"""Unwrap the positions of single-turn encoders."""

from dataclasses import dataclass

import numpy as np

from jointid.arrays import Floats
from jointid.importing.map.mapping import Channel
from jointid.wording import counted

_TURN = {"rad": 2 * np.pi, "mrad": 2e3 * np.pi, "deg": 360.0, "rev": 1.0}
_COUNTERS = tuple(2.0**bits for bits in range(8, 33))
"""Ranges of counters of 8 to 32 bits, at which they overflow whatever the counts per turn."""
_MAX_POSITION = 1e12  # larger values are damage
_MAX_MOTION = 0.2  # motion in one sample that a wrap may contain, in turns
_MAX_STEPS = 20.0  # the same in usual steps of the motion (90 % quantile)


@dataclass(frozen=True, eq=False)
class Unwrapped:
    """Continuous positions."""

    values: Floats
    jumps: np.ndarray
    """Index of the first value after each jump that was removed; may be empty."""
    turn: float
    """In the column's unit."""

    def note(self, channel: Channel, first: str = "") -> str:
        """Return a sentence for the user; ``first`` names the place of the first jump."""
        times = counted(self.jumps.size, "time")
        return (
            f'"{channel.column}" covers one turn only and jumps {times} by {self.turn:.6g} '
            f"{channel.unit}{first}: the jumps are removed."
        )


def unwrapped(values: Floats, channel: Channel) -> Unwrapped:
    """Remove the jumps of a single-turn encoder from finite positions (N,) in the column's unit.

    A jump of nearly a turn between neighbours is a wrap when all values lie within one turn and no step
    is nearly as large otherwise. Counts may wrap at the counts per turn, or where a counter of 8 to 32
    bits overflows.
    """
    none = Unwrapped(values, np.zeros(0, dtype=int), 0.0)
    if values.size < 3 or np.abs(values).max() > _MAX_POSITION:
        return none
    steps = np.diff(values)
    span = float(np.ptp(values))
    for turn in _turns(channel):
        if not 0.5 * turn < span <= 1.001 * turn:
            continue
        turns = np.round(steps / turn)
        jumps = np.flatnonzero(turns)
        if not jumps.size or jumps.size > _MAX_MOTION * steps.size:
            continue
        left = np.abs(steps - turns * turn)
        # Steps of the motion itself are far smaller; at rest they are noise, or one count.
        usual = float(np.quantile(np.delete(left, jumps), 0.9))
        if left.max() > _MAX_MOTION * turn or left[jumps].max() > max(_MAX_STEPS * usual, 1e-3 * turn):
            continue
        whole = np.concatenate([[0.0], np.cumsum(turns)])
        return Unwrapped(values - turn * whole, jumps + 1, turn)
    return none


def _turns(channel: Channel) -> tuple[float, ...]:
    if channel.unit == "counts":
        per_turn = abs(channel.scale or 1.0)
        return ((per_turn,) if per_turn >= 8 else ()) + _COUNTERS
    return (_TURN[channel.unit],) if channel.unit in _TURN else ()
