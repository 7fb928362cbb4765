"""Friction at the motors as phasors: what Coulomb's law and the reversals contribute at each harmonic.

The velocity of a motor over one period follows from the harmonics of its angle, differentiated
analytically. While the motor slides, Coulomb friction is F_c sign θ̇. Around a reversal it may stick, and
the friction torque is then whatever holds it: no function of velocity, hence unknown. There the friction
is left free at the resolution of the harmonics, so that nothing is assumed of its shape.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.estimation.free_friction import FreeFriction
from jointid.phasors.extract import Phasors

_HATS_PER_HARMONIC = 3
"""Hat functions per period for each harmonic: closer than the harmonics can resolve."""

_WIDTHS = (0.02, 0.07, 0.25)
"""Of a friction curve's fading parts, as shares of the joint's largest velocity over all records."""

_GRID = 1024  # points per period; many times the highest harmonic


@dataclass(frozen=True, eq=False)
class FrictionWaveforms:
    """Phasors of the friction torques that a unit of each parameter would make."""

    coulomb: Complexes
    """Of sign θ̇, shape (r, H, n); zero where the motor never reverses."""
    curve: Complexes
    """Of sign θ̇ · exp(−|θ̇|/w) for several widths w, shape (r, H, n, c): what a friction curve that
    rises or falls with speed has beyond Coulomb's."""
    free: FreeFriction
    """Waveforms in which friction is free around the reversals."""
    standing: np.ndarray
    """Whether the joint hardly moves in the record: its friction is unknown throughout, and with it its
    torque balance says nothing, shape (r, n)."""


def friction_waveforms(phasors: Phasors, window: float, *, curve: bool = False) -> FrictionWaveforms:
    """Fourier coefficients of sign θ̇ and of the free shapes around every reversal.

    Parameters
    ----------
    phasors : Phasors
        With harmonics; few of them blur the reversals.
    window : float
        A reversal is where |θ̇| is below this share of the record's largest, or within the noise of θ̇;
        0 takes sign θ̇ as it is.
    curve : bool, default False
        Whether friction may change with speed beyond its viscous part (Stribeck's curve, a soft sign).
    """
    H, n = phasors.harmonics.shape[1], phasors.n
    rate = 1j * phasors.omega[:, None] * np.arange(1, H + 1)
    angle = phasors.harmonics[..., :n]
    swing = (rate[..., None] * angle).swapaxes(1, 2)
    velocity = _samples(swing) + phasors.drift[:, :, None]
    variance = np.einsum("rhjj->rhj", phasors.harmonic_covariance[..., :n, :n]).real
    noise = np.sqrt(0.5 * np.einsum("rh,rhj->rj", np.abs(rate) ** 2, variance))
    largest = np.abs(velocity).max(axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(largest > 0, np.maximum(window, 4 * noise / largest), 1.0)
    standing = share > 0.5

    signs = np.where(standing[..., None], 0.0, np.sign(velocity))
    free = FreeFriction(())
    if window > 0:
        carried = np.any(phasors.harmonics != 0, axis=2).sum(axis=1)
        threshold = np.where(standing, np.inf, share * largest)
        free = _freed(velocity, signs, threshold, carried, H)
    reverses = (signs.min(axis=2) < 0) & (signs.max(axis=2) > 0)
    coulomb = _phasors_of(signs, H).swapaxes(1, 2) * reverses[:, None]
    fading = np.zeros((*coulomb.shape, len(_WIDTHS) if curve else 0), complex)
    for c in range(fading.shape[3]):
        width = _WIDTHS[c] * largest.max(axis=0)[:, None]  # (n, 1), rad/s
        with np.errstate(divide="ignore", invalid="ignore"):
            fades = signs * np.nan_to_num(np.exp(-np.abs(velocity) / width))
        fading[..., c] = _phasors_of(fades, H).swapaxes(1, 2)
    return FrictionWaveforms(coulomb, fading, free, standing)


@lru_cache(maxsize=4)
def _waves(H: int) -> Complexes:
    """Of e^{ihφ} a period's samples, (H, t)."""
    return np.asarray(np.exp(2j * np.pi * np.outer(np.arange(1, H + 1), np.arange(_GRID) / _GRID)))


@lru_cache(maxsize=4)
def _pairs(H: int) -> Floats:
    """Sines above cosines, (2H, t): real and imaginary parts of phasors make samples with them."""
    return np.concatenate([_waves(H).imag, _waves(H).real])


def _samples(phasors: Complexes) -> Floats:
    """A period's samples (r, n, t) of phasors (r, n, H); one product of contiguous matrices."""
    parts = np.concatenate([phasors.real, phasors.imag], axis=2)
    flat = parts.reshape(-1, parts.shape[2]) @ _pairs(phasors.shape[2])
    return np.asarray(flat.reshape(*phasors.shape[:2], _GRID))


def _phasors_of(samples: Floats, H: int) -> Complexes:
    """Phasors (r, n, H) of a period's samples (r, n, t)."""
    parts = (samples.reshape(-1, _GRID) @ _pairs(H).T) * (2 / _GRID)
    return np.asarray((parts[:, :H] + 1j * parts[:, H:]).reshape(*samples.shape[:2], H))


def _freed(
    velocity: Floats, signs: Floats, threshold: Floats, carried: np.ndarray, H: int
) -> FreeFriction:
    """Hats that span each reversal, in which |velocity| (r, n, t) is below the threshold (r, n).

    Puts the jump of ``signs`` in the middle of the reversal.
    """
    r, n, _ = velocity.shape
    shapes_of = []
    for record in range(r):
        columns = [np.zeros((H, n, 0), complex)]
        for joint in range(n):
            sign = signs[record, joint]
            for begin, length, before in _reversals(velocity[record, joint], threshold[record, joint]):
                steps = np.arange(length + 1)
                sign[(begin + steps) % _GRID] = np.where(steps < length / 2, before, -before)
                pieces = int(np.ceil(_HATS_PER_HARMONIC * carried[record] * length / _GRID))
                late = _waves(H)[:, begin % _GRID].conj()
                column = np.zeros((H, n, pieces + 1), complex)
                column[:, joint] = _hats(length, pieces, H) * late[:, None]
                columns.append(column)
        shapes_of.append(np.concatenate(columns, axis=2))
    return FreeFriction.of(shapes_of)


def _reversals(velocity: Floats, threshold: float) -> list[tuple[int, int, float]]:
    """Last sample before each reversal, how many samples to the first after it, and the sign before."""
    slides = np.flatnonzero(np.abs(velocity) > threshold)
    direction = np.sign(velocity[slides])
    turns = np.flatnonzero(direction[1:] != direction[:-1]).tolist()
    found = [(int(slides[k]), int(slides[k + 1] - slides[k]), float(direction[k])) for k in turns]
    if slides.size and direction[-1] != direction[0]:
        found.append((int(slides[-1]), int(slides[0] + _GRID - slides[-1]), float(direction[-1])))
    return found


@lru_cache(maxsize=128)
def _hats(length: int, pieces: int, H: int) -> Complexes:
    """Phasors (H, pieces + 1) of hats that share ``length`` samples from the first on."""
    steps = np.arange(length + 1)
    hats = 1 - np.abs(steps * pieces / length - np.arange(pieces + 1)[:, None])
    return np.asarray(_waves(H)[:, steps % _GRID].conj() @ np.maximum(hats, 0).T * (2j / _GRID))
