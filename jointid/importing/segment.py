"""One steady stretch of a log, and the measure of what moves in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.importing.line_fit import fit_lines
from jointid.wording import listed, shown

HARMONICS = 3
"""Fitted beside the fundamental of a single sine, so that friction does not shift the frequency."""

_SECOND_LINE = 0.08  # amplitude of another line over the largest that makes a multisine
_HARMONIC = 0.15  # the same for a multiple of the largest's frequency, which friction makes as well


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


def lines_worth(time: Floats, theta: Floats, lines: Sequence[float]) -> list[float]:
    """Drop harmonics of the strongest line, and lines too small to be meant.

    Parameters
    ----------
    time : ndarray, shape (N,)
    theta : ndarray, shape (N, n)
    lines : sequence of float
        At least one, Hz.
    """
    fit = fit_lines(time, theta, lines, free=False)
    size = np.linalg.norm(fit.phasors / np.maximum(fit.moved, 1e-300), axis=1)
    strongest = int(np.argmax(size))
    kept = []
    for k, line in enumerate(lines):
        order = line / lines[strongest]
        resolution = 1.5 / (time[-1] - time[0]) / lines[strongest]
        is_harmonic = round(order) > 1 and abs(order - round(order)) < resolution
        least = _HARMONIC if is_harmonic else _SECOND_LINE
        if k == strongest or size[k] > least * size[strongest]:
            kept.append(line)
    return kept
