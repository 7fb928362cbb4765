"""Friction at the motors as phasors: Coulomb friction and free friction at the reversals, by harmonic.

The velocity of a motor over one period follows from the harmonics of its angle, differentiated
analytically. While the motor slides, Coulomb friction is F_c sign θ̇. Around a reversal the motor may
stick, and the friction torque is then not a function of the velocity. There the friction is free, with
the resolution of the harmonics, so that no waveform is assumed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.motion.complement import Waveforms
from jointid.motion.free_friction import FreeFriction
from jointid.motion.reversals import segment_friction
from jointid.phasors.extract import Phasors
from jointid.phasors.periods import phasors_of, samples_of, waves
from jointid.phasors.segment import Motors, bins_of

_HATS_PER_HARMONIC = 3
"""Hat functions per period for each harmonic: finer than the harmonics resolve."""

_WIDTHS = (0.01, 0.024, 0.06, 0.145, 0.35)
"""Decay velocities of the friction curve's parts, over the joint's largest velocity in a usual record of
sines (the median: others hardly move a joint that its controller holds) or in all motions. Over a sine,
they leave 1 % of a Stribeck curve that falls as a Gaussian, and less of others; three left 2 %."""

GRID = 1024
"""Points per period; many times the highest harmonic, also of effects per turn of the motors."""

_NOISE_MARGIN = 4.0
"""Standard deviations of the velocity within which its sign is unknown."""

_SEEN = 6.0
"""Power of a harmonic over its noise from which the velocity has it: an exponential distribution
exceeds it once in 400."""

_STATIONARY = 0.25
"""Share of the largest velocity with unknown sign from which a joint counts as stationary: one slip of a
joint that sticks gives all harmonics, with up to some five of their standard deviations."""

_DIFFERS = 0.5
"""Standard deviation of the friction of one sine from that of all, over the latter."""

_SHORT = 0.5
"""Periods of the highest harmonic below which a slow stretch without reversal is not resolved."""

_STICKING = 0.5
"""Share of the period without clear velocity from which it does, too: it sticks, but for short slips."""


@dataclass(frozen=True, eq=False)
class FrictionWaveforms:
    """Phasors of the friction torque per unit of each parameter."""

    coulomb: Complexes
    """Phasors of sign θ̇, shape (r, H, n); zero where the motor never reverses."""
    curve: Complexes
    """Phasors of sign θ̇ · exp(−|θ̇|/w) for several widths w, shape (r, H, n, c): friction that rises or
    falls with speed, in addition to Coulomb friction."""
    unknown: Sequence[Waveforms]
    """Unknown friction of every record: free, or bounded by the Coulomb friction."""
    sizes: Floats
    """Standard deviation of the bounded friction, shape (r, n), N·m of the logged torque."""
    stationary: np.ndarray
    """Whether the joint's motion is within its noise for most of the time, shape (r, n): its friction is
    then unknown over the whole period, and its residual carries no information."""
    direction: Sequence[Floats]
    """Sign of θ̇ over every record, each (n, points)."""
    levels: Complexes
    """Phasors of friction that differs from record to record, per standard deviation, (r, H, n, c)."""
    position_filter: Floats = field(default_factory=lambda: np.zeros(1))
    """Time constants of the position filters that are removed from the velocities, (n,), s."""
    further: Mapping[str, Complexes] = field(default_factory=dict)
    """Phasors of further torques per unit of their parameters, each (r, H, n): of "load", sign θ̇ times
    the magnitude of the gear torque (``with_load``), and of torque ripple (``per_turn``)."""
    deflection: Mapping[str, Complexes] = field(default_factory=dict)
    """Phasors of deflections of the gears without torque, likewise: of transmission error."""

    @property
    def by_parameter(self) -> dict[str, Complexes]:
        """Torque at the motors per unit of each parameter, (r, H, n); "curve 0" is its first part."""
        curve = {f"curve {c}": self.curve[..., c] for c in range(self.curve.shape[3])}
        return {"coulomb": self.coulomb, **curve, **self.further}

    @cached_property
    def free(self) -> FreeFriction:
        """Free friction waveforms around the reversals."""
        return FreeFriction.of(self.unknown, self.sizes, self.levels)


def friction_waveforms(
    phasors: Phasors,
    window: float | None,
    *,
    curve: bool = False,
    position_filter: Floats | None = None,
) -> FrictionWaveforms:
    """Fourier coefficients of sign θ̇ and of the free friction around every reversal.

    The more harmonics, the sharper the reversals. A reversal is where |θ̇| is below the share ``window``
    of the record's largest, or within the noise of θ̇; None uses sign θ̇ everywhere. ``curve`` is whether
    friction varies nonlinearly with speed (Stribeck curve, gradual sign change), ``position_filter``,
    shape (n,), the time constants of first-order filters of the logged positions, s: the motors of sines
    reverse where the positions before the filters do.
    """
    if position_filter is not None and not phasors.motion.any():
        own = friction_waveforms(_unfiltered(phasors, position_filter), window, curve=curve)
        return replace(own, position_filter=position_filter)
    if phasors.motion.any():
        return _of_segments(phasors, window, curve)
    H, n = phasors.harmonics.shape[1], phasors.n
    velocity, noise = _velocities(phasors)
    largest = np.abs(velocity).max(axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(largest > 0, np.maximum(window or 0.0, _NOISE_MARGIN * noise / largest), 1.0)
    unclear = np.mean(np.abs(velocity) <= _NOISE_MARGIN * noise[..., None], axis=2)
    stationary = (share > _STATIONARY) | (unclear > _STICKING)
    signs = np.where(stationary[..., None], 0.0, np.sign(velocity))
    known, none = np.any(phasors.harmonics != 0, axis=2), [np.zeros((H, 0), complex)] * n
    free: list[Sequence[Complexes]] = [none] * len(known)
    if window:
        threshold = np.where(stationary, np.inf, share * largest)
        free = _freed(velocity, signs, threshold, known.sum(axis=1), H)
    reverses = (signs.min(axis=2) < 0) & (signs.max(axis=2) > 0)
    coulomb = phasors_of(signs, H).swapaxes(1, 2) * reverses[:, None]
    fading = np.zeros((*coulomb.shape, len(_WIDTHS) if curve else 0), complex)
    if curve:
        moved = [own[~rests] for own, rests in zip(largest.T, stationary.T, strict=True)]
        usual = np.array([np.median(own) if own.size else 1.0 for own in moved])
    for c in range(fading.shape[3]):
        width = _WIDTHS[c] * usual[:, None]  # (n, 1), rad/s
        with np.errstate(divide="ignore", invalid="ignore"):
            fades = signs * np.nan_to_num(np.exp(-np.abs(velocity) / width))
        fading[..., c] = phasors_of(fades, H).swapaxes(1, 2)
    equations = known[..., None] & ~stationary[:, None]
    unknown = [Waveforms(own, none, used) for own, used in zip(free, equations, strict=True)]
    none_bounded = np.zeros(stationary.shape)
    one: Complexes = np.zeros((*coulomb.shape, 0), complex)
    return FrictionWaveforms(coulomb, fading, unknown, none_bounded, stationary, list(signs), one)


def _velocities(phasors: Phasors) -> tuple[Floats, Floats]:
    """Velocities of the motors over a period of every sine, (r, n, points), and their noise, (r, n)."""
    n, orders = phasors.n, np.arange(1, phasors.harmonics.shape[1] + 1)
    rate, angle = 1j * phasors.omega[:, None] * orders, phasors.harmonics[..., :n]
    variance, seen = seen_angles(phasors)
    swing = (rate[..., None] * angle * seen).swapaxes(1, 2)
    # What the other harmonics hold beyond their noise adds to that of those seen.
    squares = np.stack([variance * seen, (np.abs(angle) ** 2 - variance) * ~seen])
    power = 0.5 * np.einsum("rh,krhj->krj", np.abs(rate) ** 2, squares)
    noise = np.sqrt(power[0] + np.maximum(power[1], 0.0))
    return samples_of(swing, GRID) + phasors.drift[:, :, None], np.asarray(noise)


@dataclass(frozen=True, eq=False)
class GearTorque:
    """Torque through the gears as the balance at the motors leaves it, N·m."""

    sines: Floats
    """Over a period of every sine, shape (rows, n, points)."""
    segments: Mapping[int, Floats]
    """Over the segments of motions by their row, each (n, N)."""


def gear_torque_of(
    friction: FrictionWaveforms, phasors: Phasors, motors: Sequence[Motors], *, loaded: bool
) -> GearTorque:
    """Torque through the gears by parameters of the motors of every row.

    ``loaded`` is whether a share of it may be friction, which is then subtracted.
    """
    if friction.position_filter.any():
        phasors = _unfiltered(phasors, friction.position_filter)
    n, H = phasors.n, phasors.harmonics.shape[1]
    s = 1j * phasors.omega[:, None, None] * np.arange(1, H + 1)[:, None]
    angle, torque = phasors.harmonics[..., :n], phasors.harmonics[..., n:]
    every = Motors(*(np.stack(each) for each in zip(*motors, strict=True)))
    M, coulomb, viscous, _, lag, scale, _ = (each[:, None] for each in every)
    left = scale * torque * np.exp(-s * lag) - s * (s * M + viscous) * angle
    left -= coulomb * friction.coulomb
    of_sines: Floats = np.zeros((0, n, GRID))
    sines = np.flatnonzero(~phasors.motion)
    if sines.size:
        direction = np.stack([friction.direction[row] for row in sines.tolist()])
        own, seen = Motors(*(each[sines] for each in every)), seen_angles(phasors)[1]
        if not loaded:  # no sign of a velocity is multiplied: clear torques count, too
            noise = np.einsum("rhjj->rhj", phasors.harmonic_covariance[..., n:, n:]).real
            seen = seen | (np.abs(torque) ** 2 > _SEEN * noise)
        seen = seen[sines].swapaxes(1, 2)
        mean = own.torque_scale * phasors.mean_torque[sines] - own.viscous * phasors.drift[sines]
        mean -= own.coulomb * direction.mean(axis=2)
        total = mean[..., None] + samples_of(left[sines].swapaxes(1, 2), direction.shape[2])

        def clear(torque: Floats) -> Floats:
            mean = torque.mean(axis=2, keepdims=True)
            return np.asarray(mean + samples_of(phasors_of(torque, H) * seen, torque.shape[2]))

        of_sines = own.without_load_friction(total, direction, clear)
    rows = {row: each for row, each in enumerate(phasors.segments) if each is not None}
    of_rows = {row: each.gear_torque(motors[row], friction.direction[row]) for row, each in rows.items()}
    return GearTorque(of_sines, of_rows)


def with_load(friction: FrictionWaveforms, phasors: Phasors, gear: GearTorque) -> FrictionWaveforms:
    """Waveforms with that of friction which is a share of the torque through the gear."""
    found, H = np.zeros_like(friction.coulomb), phasors.harmonics.shape[1]
    sines = np.flatnonzero(~phasors.motion)
    if sines.size:
        direction = np.stack([friction.direction[row] for row in sines.tolist()])
        found[sines] = phasors_of(np.abs(gear.sines) * direction, H).swapaxes(1, 2)
    for row, torque in gear.segments.items():
        every = bins_of(
            np.abs(torque) * friction.direction[row], H
        ).T  # those beyond its band are unused
        found[row, : len(every)] = every
    load = found * np.any(phasors.harmonics != 0, axis=2)[..., None]
    return replace(friction, further={**friction.further, "load": load})


def with_levels(
    friction: FrictionWaveforms, phasors: Phasors, coulomb: Floats, viscous: Floats
) -> FrictionWaveforms:
    """Waveforms with Coulomb and viscous friction, each (n,), that differ between sines or segments."""
    H, n = phasors.harmonics.shape[1], phasors.n
    rate = 1j * phasors.omega[:, None, None] * np.arange(1, H + 1)[:, None] * phasors.harmonics[..., :n]
    levels = _DIFFERS * np.stack([coulomb * friction.coulomb, viscous * rate], axis=-1)
    return replace(friction, levels=levels * ~friction.stationary[:, None, :, None])


def change_of_level(friction: FrictionWaveforms, torque: Complexes) -> Floats:
    """Standard deviation between sines of the Coulomb friction in torques (r, H, n), shape (n,), N·m.

    The torques contain free friction as well.
    """
    change: Floats = np.full(friction.stationary.shape, np.nan)
    for row, joint in np.argwhere(friction.coulomb.any(axis=1)).tolist():
        known = friction.unknown[row].known[:, joint]
        columns = np.column_stack(
            [friction.coulomb[row, known, joint], friction.unknown[row].free[joint][known]]
        )
        left = torque[row, known, joint]
        rows, right = (np.concatenate([each.real, each.imag]) for each in (columns, left))
        change[row, joint] = np.linalg.lstsq(rows, right)[0][0]
    few = np.count_nonzero(np.isfinite(change), axis=0) < 2
    change[:, few] = 0.0
    return np.asarray(np.nanstd(change, axis=0))


def seen_angles(phasors: Phasors) -> tuple[Floats, np.ndarray]:
    """Variances of the angles' harmonics, and which are above their noise or fundamentals, (r, H, n)."""
    n = phasors.n
    variance = np.einsum("rhjj->rhj", phasors.harmonic_covariance[..., :n, :n]).real
    seen = np.abs(phasors.harmonics[..., :n]) ** 2 > _SEEN * variance
    seen[:, 0] = True
    return variance, seen


def _unfiltered(phasors: Phasors, position_filter: Floats) -> Phasors:
    """Phasors whose angles are those before filters of the given time constants, shape (n,)."""
    z, n = phasors.harmonics, phasors.n
    gain = np.ones(z.shape, complex)
    order = np.arange(1, z.shape[1] + 1)[:, None]
    gain[..., :n] += 1j * phasors.omega[:, None, None] * order * position_filter
    covariance = gain[..., None] * phasors.harmonic_covariance * gain[..., None, :].conj()
    return replace(phasors, harmonics=gain * z, harmonic_covariance=covariance)


def _of_segments(phasors: Phasors, window: float | None, curve: bool) -> FrictionWaveforms:
    """Waveforms of sines and of segments of motion records."""
    (r, H, _), n = phasors.harmonics.shape, phasors.n
    segments = {k: each for k, each in enumerate(phasors.segments) if each is not None}
    sines = np.flatnonzero(~phasors.motion)
    largest = np.max([np.abs(each.velocity).max(axis=1) for each in segments.values()], axis=0)
    widths = np.outer(largest, _WIDTHS if curve else ())
    coulomb, fading = np.zeros((r, H, n), complex), np.zeros((r, H, n, widths.shape[1]), complex)
    stationary, sizes = np.zeros((r, n), bool), np.zeros((r, n))
    unknown, direction = np.empty((2, r), object)
    if sines.size:
        own = friction_waveforms(phasors.select(sines), window, curve=curve)
        coulomb[sines], fading[sines], stationary[sines] = own.coulomb, own.curve, own.stationary
        unknown[sines] = own.unknown
        for row, signs in zip(sines.tolist(), own.direction, strict=True):
            direction[row] = signs
    for row, segment in segments.items():
        found, bins = segment_friction(segment, window, widths), slice(segment.highest)
        coulomb[row, bins], fading[row, bins], direction[row], unknown[row], stationary[row] = found
        sizes[row] = segment.unknown_Nm
    one: Complexes = np.zeros((r, H, n, 0), complex)
    return FrictionWaveforms(
        coulomb, fading, unknown.tolist(), sizes, stationary, direction.tolist(), one
    )


def _freed(
    velocity: Floats, signs: Floats, threshold: Floats, carried: np.ndarray, H: int
) -> list[Sequence[Complexes]]:
    """Hat functions over each stretch in which |velocity| (r, n, t) is below the threshold (r, n).

    A motor may stick there, whether it turns back or goes on. Moves the step of ``signs`` to the middle
    of the stretch, in place.
    """
    r, n, _ = velocity.shape
    free: list[Sequence[Complexes]] = []
    for record in range(r):
        own = []
        for joint in range(n):
            columns = [np.zeros((H, 0), complex)]
            sign = signs[record, joint]
            for begin, length, before, after in _slow(velocity[record, joint], threshold[record, joint]):
                resolved = carried[record] * length / GRID
                if before == after and resolved < _SHORT:
                    continue
                steps = np.arange(length + 1)
                sign[(begin + steps) % GRID] = np.where(steps < length / 2, before, after)
                pieces = int(np.ceil(_HATS_PER_HARMONIC * resolved))
                late = waves(H, GRID)[:, begin % GRID].conj()
                columns.append(_hats(length, pieces, H) * late[:, None])
            own.append(np.concatenate(columns, axis=1))
        free.append(own)
    return free


def _slow(velocity: Floats, threshold: float) -> list[tuple[int, int, float, float]]:
    """Last sample before each slow stretch, samples to the first after it, and the signs at both."""
    slides = np.flatnonzero(np.abs(velocity) > threshold)
    before, length = np.sign(velocity[slides]), np.diff(slides, append=slides[:1] + GRID)
    after = np.roll(before, -1)
    slow = (length > 1) | (before != after)
    return list(zip(*(each[slow].tolist() for each in (slides, length, before, after)), strict=True))


@lru_cache(maxsize=128)
def _hats(length: int, pieces: int, H: int) -> Complexes:
    """Phasors (H, pieces + 1) of hat functions over the first ``length`` samples."""
    steps = np.arange(length + 1)
    hats = 1 - np.abs(steps * pieces / length - np.arange(pieces + 1)[:, None])
    return np.asarray(waves(H, GRID)[:, steps % GRID].conj() @ np.maximum(hats, 0).T * (2j / GRID))
