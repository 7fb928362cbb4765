"""One steady stretch of a log, and the measure of what moves in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.importing.find.line_fit import fit_lines
from jointid.wording import listed, shown

HARMONICS = 3
"""Fitted beside the fundamental of a single sine, so that friction does not shift the frequency."""

_SMALLEST = 0.03  # share in position or torque, over the largest, below which a line is not meant
_HARMONIC = 0.25  # torque and acceleration over those of the one line of which all are multiples
_EVEN = 0.1  # the same of an even multiple, and where lines are that are no multiples: those are meant
_CLEAR = 5.0  # amplitude over the noise about it
_STILL = 0.02  # motion of a joint, over the largest, below which its lines tell nothing


@dataclass(frozen=True)
class Segment:
    """A stretch of a log in which every joint follows steady sines.

    Parameters
    ----------
    start_s, stop_s : float
        Settled part, on the clock of the log; the sample at ``stop_s`` belongs to it.
    frequency_hz : float
        The frequency, or the strongest of several lines.
    lines_hz : sequence of float, optional
        All lines at once, ascending; by default the one.
    frequency_error_hz : float, optional
        Standard error of the frequency; NaN where the user gave it.
    share : float, optional
        Share of the motor's motion that the lines explain, joint that they explain best.
    torque_share : float, optional
        The same of the torque.
    amplitude_rad : sequence of float, optional
        Of each motor at ``frequency_hz``.

    Raises
    ------
    JointIdError
        When it is empty, or a frequency is not positive.
    """

    start_s: float
    stop_s: float
    frequency_hz: float
    lines_hz: tuple[float, ...] = ()
    frequency_error_hz: float = float("nan")
    share: float = float("nan")
    torque_share: float = float("nan")
    amplitude_rad: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name in ("start_s", "stop_s", "frequency_hz"):
            value = getattr(self, name)
            if not isinstance(value, float | int | np.floating) or not np.isfinite(value):
                raise JointIdError(f"{name} = {shown(value)}: expected a finite number.")
            object.__setattr__(self, name, float(value))
        lines = tuple(sorted(float(line) for line in (self.lines_hz or (self.frequency_hz,))))
        if min(lines) <= 0:
            raise JointIdError(f"A segment's frequency is {min(lines):g} Hz: it must be positive.")
        if self.frequency_hz not in lines:
            raise JointIdError(
                f"frequency_hz = {self.frequency_hz:g} Hz is not among lines_hz, "
                f"{listed(f'{line:g}' for line in lines)} Hz: give it there too."
            )
        if not self.stop_s > self.start_s:
            raise JointIdError(
                f"A segment from {self.start_s:g} s to {self.stop_s:g} s is empty: the stop must come "
                "later."
            )
        object.__setattr__(self, "lines_hz", lines)
        object.__setattr__(self, "amplitude_rad", tuple(float(a) for a in self.amplitude_rad))

    @property
    def periods(self) -> float:
        """Periods of ``frequency_hz``."""
        return (self.stop_s - self.start_s) * self.frequency_hz

    @property
    def is_multisine(self) -> bool:
        """Whether several lines are there at once."""
        return len(self.lines_hz) > 1


def measured(time: Floats, theta: Floats, tau: Floats, lines_hz: Sequence[float]) -> Segment:
    """Fit lines to positions and torques together and return the segment.

    Parameters
    ----------
    time : ndarray, shape (N,)
    theta, tau : ndarray, shape (N, n)
    lines_hz : sequence of float
        Starting values, see ``fit_lines``.
    """
    signals = np.column_stack([theta, tau])
    fit = fit_lines(time, signals, lines_hz, harmonics=HARMONICS if len(lines_hz) == 1 else 1)
    n = theta.shape[1]
    strongest = int(np.argmax(np.linalg.norm(fit.phasors[:, :n], axis=1)))
    return Segment(
        start_s=float(time[0]),
        stop_s=float(time[-1]),
        frequency_hz=float(fit.frequency_hz[strongest]),
        lines_hz=tuple(fit.frequency_hz.tolist()),
        frequency_error_hz=float(fit.error_hz[strongest]),
        share=float(fit.share[:n].max()),
        torque_share=float(fit.share[n:].max()),
        amplitude_rad=tuple(np.abs(fit.phasors[strongest, :n]).tolist()),
    )


def lines_worth(time: Floats, theta: Floats, tau: Floats, lines: Sequence[float]) -> list[float]:
    """Drop harmonics of other lines, lines that only noise makes, and lines too small to be meant.

    The position of a driven line falls with the square of its frequency while its torque does not, so
    a line counts by the larger of its shares in either. A harmonic that friction makes is large in
    the torque at best, one that rounding makes in the acceleration: a line that is driven at a multiple
    of another is large in both.

    Parameters
    ----------
    time : ndarray, shape (N,)
    theta, tau : ndarray, shape (N, n)
    lines : sequence of float
        At least one, Hz.
    """
    n = theta.shape[1]
    hz = np.asarray(lines, float)
    size, floor, moved = line_sizes(time, np.column_stack([theta, tau]), hz)
    size = np.where(size > _CLEAR * floor, size, 0.0)
    moves = moved[:n] > _STILL * moved[:n].max()
    size[:, np.flatnonzero(~np.concatenate([moves, moves]))] = 0.0
    scaled = size / np.maximum(size.max(axis=0), 1e-300)
    position, torque = np.linalg.norm(scaled[:, :n], axis=1), np.linalg.norm(scaled[:, n:], axis=1)
    clear = (position > 0) & (torque > 0)
    strongest = int(np.argmax(position * torque if clear.any() else position))
    share = np.maximum(position / max(position.max(), 1e-300), torque / max(torque.max(), 1e-300))
    meant = clear & (share > _SMALLEST)
    meant[strongest] = True
    hz, position, torque = hz[meant], position[meant], torque[meant]
    span = float(time[-1] - time[0])
    kept = [
        float(line)
        for k, line in enumerate(hz)
        if not any(_made_by(k, g, hz, position, torque, span) for g in range(len(hz)))
    ]
    return kept or [float(lines[strongest])]


def _made_by(k: int, g: int, hz: Floats, position: Floats, torque: Floats, span: float) -> bool:
    """Whether line ``k`` is a harmonic that friction or rounding makes of line ``g``."""
    orders = hz / hz[g]
    multiples = np.abs(orders - np.round(orders)) < 1.5 / span / hz[g]
    order = round(orders[k])
    if order < 2 or not multiples[k] or position[g] == 0 or torque[g] == 0:
        return False
    acceleration = order**2 * position[k] / position[g]
    least = _HARMONIC if multiples.all() and order % 2 else _EVEN
    return bool(min(acceleration, torque[k] / torque[g]) < least)


def line_sizes(time: Floats, signals: Floats, hz: Floats) -> tuple[Floats, Floats, Floats]:
    """Amplitudes of lines and of the noise about them; a window keeps one line from another.

    Parameters
    ----------
    time : ndarray, shape (N,)
    signals : ndarray, shape (N, c)
    hz : ndarray, shape (L,)

    Returns
    -------
    size, floor : ndarray, shape (L, c)
    moved : ndarray, shape (c,)
        Root mean square of all that moves in the window, offset and drift aside.
    """
    count = len(time)
    clock = time - (time[0] + time[-1]) / 2
    window = np.hanning(count)[:, None]
    waves = np.exp(2j * np.pi * np.outer(clock, hz))
    basis = np.column_stack([np.ones(count), clock / (clock[-1] - clock[0]), waves.real, waves.imag])
    basis *= window
    data = (signals - signals.mean(axis=0)) * window
    coefficients = np.linalg.pinv(basis.T @ basis, hermitian=True) @ (basis.T @ data)
    rest = data - basis @ coefficients
    lines = len(hz)
    size = np.hypot(coefficients[2 : 2 + lines], coefficients[2 + lines :])
    amplitude = 2 * np.abs(np.fft.rfft(rest, axis=0)) / window.sum()
    floors = np.zeros_like(size)
    for k, place in enumerate(np.round(hz * (time[-1] - time[0])).astype(int)):
        about = np.r_[max(2, place - 20) : max(2, place - 2), place + 3 : place + 21]
        about = about[about < len(amplitude)]
        if about.size:
            floors[k] = np.median(amplitude[about], axis=0)
    moved = np.sqrt(((data - basis[:, :2] @ coefficients[:2]) ** 2).mean(axis=0))
    return size, floors, moved
