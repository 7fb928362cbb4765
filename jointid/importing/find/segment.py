"""One steady span of a log, and the sizes of the lines in it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointid.arrays import Floats, finite_array, set_fields
from jointid.errors import JointIdError
from jointid.importing.find.lines import fit_lines
from jointid.phasors.fitted_sine import sine_basis
from jointid.wording import listed

FEWEST_PERIODS = 5
"""Fewest periods, of the lowest line, of a segment that is found automatically."""
HARMONICS = 3
"""Highest harmonic fitted to a single sine, so that friction does not shift its frequency."""
MIN_SNR = 5.0
"""Amplitude of a line over its noise floor."""

_MIN_SHARE = 0.03  # amplitude over the largest, in position or torque, of a line that is excited
_ODD_HARMONIC = 0.25  # torque or acceleration over the fundamental's, below which friction explains it
_IN_A_SERIES = 0.5  # the same where the torque falls to the next odd multiple as that of friction does
_FALL = 1.1  # ratio of both torques, over that of a square wave, below which it does
_OTHER_HARMONIC = 0.1  # the same at even multiples, and with lines that are no multiples
_SEVERAL = 4  # fewest lines that friction cannot cause from one
_MIN_MOTION = 0.02  # motion of a joint over the largest, below which its lines are ignored
_FLOOR_BINS = 20  # spectral bins to each side of a line that give its noise floor


@dataclass(frozen=True)
class Segment:
    """A span of a log in which every joint follows steady sines, or any other motion.

    Raises JointIdError when it is empty, or a frequency is not positive.
    """

    start_s: float
    stop_s: float
    """Settled part, on the clock of the log; the sample at ``stop_s`` belongs to it."""
    frequency_hz: float
    """The frequency, or the strongest of several lines; NaN for another motion."""
    lines_hz: tuple[float, ...] = ()
    """All lines at once, ascending; by default the one."""
    frequency_error_hz: float = float("nan")
    """Standard error of the frequency; NaN where the user gave it."""
    share: float = float("nan")
    """Share of the motor's motion that the lines explain, for the joint they explain best."""
    torque_share: float = float("nan")
    """The same for the torque."""
    band_hz: tuple[float, float] | None = None
    """Lowest and highest frequency to use of a motion that is no sine."""

    def __post_init__(self) -> None:
        band = self.band_hz
        for name in ("start_s", "stop_s", *(() if band else ("frequency_hz",))):
            set_fields(self, **{name: float(finite_array(name, getattr(self, name), ndim=0))})
        lines = tuple(sorted(float(line) for line in (self.lines_hz or (self.frequency_hz,))))
        if band is not None:
            lines = ()
            set_fields(self, band_hz=(float(band[0]), float(band[1])))
        elif min(lines) <= 0:
            raise JointIdError(f"The frequency of a run is {min(lines):g} Hz: it must be positive.")
        elif self.frequency_hz not in lines:
            raise JointIdError(
                f"frequency_hz = {self.frequency_hz:g} Hz is not among lines_hz, "
                f"{listed(f'{line:g}' for line in lines)} Hz: add it."
            )
        if not self.stop_s > self.start_s:
            raise JointIdError(
                f"A run from {self.start_s:g} s to {self.stop_s:g} s is empty: give a later stop."
            )
        set_fields(self, lines_hz=lines)

    @property
    def periods(self) -> float:
        """Periods of ``frequency_hz``."""
        return (self.stop_s - self.start_s) * self.frequency_hz

    @property
    def is_motion(self) -> bool:
        """Whether it is a motion other than a steady sine."""
        return self.band_hz is not None

    @property
    def is_multisine(self) -> bool:
        """Whether several lines are excited at once."""
        return len(self.lines_hz) > 1


def measured(
    time: Floats, theta: Floats, tau: Floats, lines_hz: Sequence[float], *, free: bool = True
) -> Segment:
    """Fit lines to positions and torques (N, n) together and return the segment; see ``fit_lines``."""
    signals = np.column_stack([theta, tau])
    fit = fit_lines(time, signals, lines_hz, harmonics=HARMONICS if len(lines_hz) == 1 else 1, free=free)
    n = theta.shape[1]
    strongest = int(np.argmax(np.linalg.norm(fit.phasors[:, :n], axis=1)))
    return Segment(
        start_s=float(time[0]),
        stop_s=float(time[-1]),
        frequency_hz=float(fit.frequency_hz[strongest]),
        lines_hz=tuple(fit.frequency_hz.tolist()),
        frequency_error_hz=float(fit.error_hz[strongest]) if free else float("nan"),
        share=float(fit.share[:n].max()),
        torque_share=float(fit.share[n:].max()),
    )


def significant_lines(time: Floats, theta: Floats, tau: Floats, lines: Sequence[float]) -> list[float]:
    """Keep the excited lines (Hz): drop harmonics of other lines, noise, and very small lines.

    The position amplitude of an excited line falls with the square of its frequency and its torque does
    not, so a line counts by the larger of its shares. A harmonic due to friction is large in torque at
    most, one due to rounding in acceleration at most; a line excited at a multiple of another in both.
    """
    n = theta.shape[1]
    hz = np.asarray(lines, float)
    size, floor, moved = line_sizes(time, np.column_stack([theta, tau]), hz)
    size = np.where(size > MIN_SNR * floor, size, 0.0)
    moves = moved[:n] > _MIN_MOTION * moved[:n].max()
    size[:, np.flatnonzero(~np.concatenate([moves, moves]))] = 0.0
    scaled = size / np.maximum(size.max(axis=0), 1e-300)
    position, torque = np.linalg.norm(scaled[:, :n], axis=1), np.linalg.norm(scaled[:, n:], axis=1)
    clear = (position > 0) & (torque > 0)
    strongest = int(np.argmax(position * torque if clear.any() else position))
    share = np.maximum(position / max(position.max(), 1e-300), torque / max(torque.max(), 1e-300))
    excited = clear & (share > _MIN_SHARE)
    excited[strongest] = True
    hz, position, torque = hz[excited], position[excited], torque[excited]
    shares = (hz, position, torque, 1.5 / float(time[-1] - time[0]))
    kept = _without_harmonics(*shares)
    if len(kept) >= _SEVERAL:
        kept = _without_harmonics(*shares, several=True)
    return kept or [float(lines[strongest])]


def _without_harmonics(
    hz: Floats, position: Floats, torque: Floats, unresolved_hz: float, *, several: bool = False
) -> list[float]:
    """Lines that are no harmonics of others due to friction or rounding.

    Among ``several`` excited lines one line may show in the motion alone, where its torque vanishes at a
    resonance, or in the torque alone; friction then spreads over many more and is small at each.
    """

    def is_harmonic(k: int, g: int) -> bool:
        if position[g] == 0 or torque[g] == 0:
            return False
        orders = hz / hz[g]
        multiples = np.abs(orders - np.round(orders)) < unresolved_hz / hz[g]
        order = round(orders[k])
        if order < 2 or not multiples[k]:
            return False
        shares = orders**2 * position / position[g], torque / torque[g]
        if several:
            return bool(max(share[k] for share in shares) < _IN_A_SERIES)
        share = np.minimum(*shares)[k]
        if not multiples.all() or order % 2 == 0:
            return bool(share < _OTHER_HARMONIC)
        following = torque[np.round(orders) == order + 2]
        falls = following.size > 0 and following.max() < _FALL * order / (order + 2) * torque[k]
        return bool(share < (_IN_A_SERIES if falls else _ODD_HARMONIC))

    each = range(len(hz))
    return [float(hz[k]) for k in each if not any(is_harmonic(k, g) for g in each)]


def line_sizes(time: Floats, signals: Floats, hz: Floats) -> tuple[Floats, Floats, Floats]:
    """Amplitudes of lines and of the noise around them (L, c), with a Hann window against leakage.

    Also the root mean square of each windowed signal without offset and drift (c,).
    """
    count = len(time)
    window = np.hanning(count)[:, None]
    clock = time - (time[0] + time[-1]) / 2
    basis = sine_basis(np.outer(clock, 2 * np.pi * hz), clock / clock[-1]) * window
    data = (signals - signals.mean(axis=0)) * window
    coefficients = np.linalg.pinv(basis.T @ basis, hermitian=True) @ (basis.T @ data)
    rest = data - basis @ coefficients
    size = np.hypot(*np.split(coefficients[:-2], 2))
    amplitude = 2 * np.abs(np.fft.rfft(rest, axis=0)) / window.sum()
    floors = np.zeros_like(size)
    for k, place in enumerate(np.round(hz * (time[-1] - time[0])).astype(int)):
        about = np.r_[
            max(2, place - _FLOOR_BINS) : max(2, place - 2), place + 3 : place + _FLOOR_BINS + 1
        ]
        about = about[about < len(amplitude)]
        if about.size:
            floors[k] = np.median(amplitude[about], axis=0)
    moved = np.sqrt(((data - basis[:, -2:] @ coefficients[-2:]) ** 2).mean(axis=0))
    return size, floors, moved
