"""Bring signals that were sampled at times of their own to the times of one of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from jointid.arrays import Floats
from jointid.importing.map.mapping import Mapping
from jointid.importing.map.unwrap import unwrapped
from jointid.wording import listed

_FEWEST = 8
_TOGETHER = 0.5
"""Share of the slowest signal's samples that have all signals, above which they share one clock."""
_LONGEST_STEP = 2.5
"""Step in usual steps of a signal, above which it is not interpolated."""


def on_one_clock(mapping: Mapping, time: Floats, signals: Sequence[Floats]) -> tuple[list[Floats], str]:
    """Interpolate signals at the times of the one with the fewest samples.

    More samples than the slowest signal has would repeat its noise and make errors look small.

    Parameters
    ----------
    mapping : Mapping
        A held torque keeps its last value; all other signals follow a cubic spline. Positions of
        single-turn encoders are unwrapped before.
    time : ndarray, shape (N,)
    signals : sequence of ndarray, shape (N,)
        Positions, then torques, NaN where a signal was not sampled.

    Returns
    -------
    signals : list of ndarray, shape (N,)
        Finite at the times of the slowest signal; the given ones if they share a clock.
    note : str
        What was done, as a sentence; "" for nothing.
    """
    known = [np.isfinite(time) & np.isfinite(signal) for signal in signals]
    if min(int(k.sum()) for k in known) < _FEWEST:
        return [*signals], ""
    start, stop = max(time[k].min() for k in known), min(time[k].max() for k in known)
    within = np.isfinite(time) & (time >= start) & (time <= stop)
    counts = [int((k & within).sum()) for k in known]
    slowest = int(np.argmin(counts))
    if np.all(known, axis=0).sum() >= _TOGETHER * counts[slowest] or counts[slowest] < _FEWEST:
        return [*signals], ""
    if any(np.any(np.diff(time[k]) <= 0) for k in known):
        return [*signals], ""
    at = time[known[slowest] & within]
    found, notes = [], []
    for j, (signal, rows) in enumerate(zip(signals, known, strict=True)):
        values = signal[rows]
        if j < mapping.n:
            turned = unwrapped(values, mapping.joints[j].position)
            values = turned.values
            notes += [" " + turned.note(mapping.joints[j].position)] if turned.jumps.size else []
        held = j >= mapping.n and mapping.torque_hold
        full = np.full(time.size, np.nan)
        full[known[slowest] & within] = (
            values[within[rows]] if j == slowest else _values_at(at, time[rows], values, held)
        )
        found.append(full)
    names = [name for name in mapping.columns if name != mapping.time.column]
    others = [
        f'"{n}"' for n, k in zip(names, known, strict=True) if not np.array_equal(k, known[slowest])
    ]
    how = " (cubic; a held torque by its last value)" if mapping.torque_hold else " (cubic)"
    return found, (
        f"Signals have times of their own. Interpolated{how} at the {at.size} times of the slowest, "
        f'"{names[slowest]}": {listed(others)}.{"".join(notes)}'
    )


def _values_at(at: Floats, time: Floats, values: Floats, held: bool) -> Floats:
    """Values of a signal at other times; NaN within a pause."""
    found = np.full(at.size, np.nan)
    steps = np.diff(time)
    pauses = np.flatnonzero(steps > _LONGEST_STEP * np.median(steps)) + 1
    for run in np.split(np.arange(time.size), pauses):
        own, values_own = time[run], values[run]
        target = slice(np.searchsorted(at, own[0]), np.searchsorted(at, own[-1], side="right"))
        if held:
            found[target] = values_own[np.searchsorted(own, at[target], side="right") - 1]
        elif run.size >= 4:
            found[target] = CubicSpline(own, values_own)(at[target])
    return found
