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
from jointid.phasors import Phasors

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
    reversals: Complexes
    """Waveforms in which friction is free, shape (r, H, n, m); where a record has fewer, zero."""
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
    r, H, _ = phasors.harmonics.shape
    n = phasors.n
    orders = np.arange(1, H + 1)
    waves, to_phasor = _transforms(H)
    rate = 1j * phasors.omega[:, None] * orders
    angle = phasors.harmonics[..., :n]
    swing = (rate[..., None] * angle).swapaxes(1, 2)
    velocity = swing.real @ waves.imag + swing.imag @ waves.real + phasors.drift[:, :, None]
    variance = np.einsum("rhjj->rhj", phasors.harmonic_covariance[..., :n, :n]).real
    noise = np.sqrt(0.5 * np.einsum("rh,rhj->rj", np.abs(rate) ** 2, variance))
    largest = np.abs(velocity).max(axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(largest > 0, np.maximum(window, 4 * noise / largest), 1.0)
    standing = share > 0.5

    carried = np.any(phasors.harmonics != 0, axis=2).sum(axis=1)
    signs = np.sign(velocity)
    shapes_of = []
    for record in range(r):
        for joint in range(n):
            if standing[record, joint]:
                signs[record, joint] = 0
                shapes_of.append(np.zeros((0, H), complex))
                continue
            threshold = share[record, joint] * largest[record, joint] if window > 0 else 0.0
            speed, sign = velocity[record, joint], signs[record, joint]
            shapes = _free_shapes(speed, sign, threshold, to_phasor, int(carried[record]))
            shapes_of.append(shapes)
    most = max(len(shapes) for shapes in shapes_of)
    reversals = np.zeros((r, H, n, n, most), complex)
    for place, shapes in enumerate(shapes_of):
        record, joint = divmod(place, n)
        reversals[record, :, joint, joint, : len(shapes)] = shapes.T
    reverses = (signs.min(axis=2) < 0) & (signs.max(axis=2) > 0)
    coulomb = (signs @ to_phasor.real + 1j * (signs @ to_phasor.imag)).swapaxes(1, 2) * reverses[:, None]
    widths = np.array(_WIDTHS if curve else ()) * largest.max(axis=0)[:, None]  # (n, c), rad/s
    with np.errstate(divide="ignore", invalid="ignore"):
        fading = np.nan_to_num(np.exp(-np.abs(velocity)[..., None] / widths[:, None]))  # (r, n, t, c)
    shapes = np.einsum("rjt,rjtc,th->rhjc", signs, fading, to_phasor, optimize=True)
    return FrictionWaveforms(coulomb, shapes, reversals.reshape(r, H, n, n * most), standing)


@lru_cache(maxsize=4)
def _transforms(H: int) -> tuple[Complexes, Complexes]:
    """From phasors to a period's samples, (H, t), and back, (t, H)."""
    waves = np.exp(2j * np.pi * np.outer(np.arange(1, H + 1), np.arange(_GRID) / _GRID))
    return waves, waves.T.conj() * (2j / _GRID)


def _free_shapes(
    velocity: Floats, sign: Floats, threshold: float, to_phasor: Complexes, harmonics: int
) -> Complexes:
    """Phasors (m, H) of hats that span each reversal; puts the jump of ``sign`` in its middle."""
    slides = np.flatnonzero(np.abs(velocity) > threshold)
    direction = np.sign(velocity[slides])
    turns = np.flatnonzero(direction[1:] != direction[:-1]).tolist()
    spans = [(slides[at], slides[at + 1], direction[at]) for at in turns]
    if slides.size and direction[-1] != direction[0]:
        spans.append((slides[-1], slides[0] + _GRID, direction[-1]))
    shapes = [np.zeros((0, to_phasor.shape[1]), complex)]
    for begin, end, before in spans:
        length = int(end - begin)
        steps = np.arange(length + 1)
        inside = (begin + steps) % _GRID
        sign[inside] = np.where(steps < length / 2, before, -before)
        if threshold > 0:
            pieces = int(np.ceil(_HATS_PER_HARMONIC * harmonics * length / _GRID))
            hats = 1 - np.abs(steps * pieces / length - np.arange(pieces + 1)[:, None])
            shapes.append(np.maximum(hats, 0) @ to_phasor[inside])
    return np.concatenate(shapes)
