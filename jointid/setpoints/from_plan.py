"""Planned records as an experiment: sines, multisines, sweeps or a planned motion."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import make_interp_spline

from jointid.arrays import Floats, bounded_number, per_joint, whole_number
from jointid.errors import JointIdError
from jointid.joints import Elasticity, Inertia
from jointid.setpoints.experiment import Experiment, Run
from jointid.simulation.motion import sampled
from jointid.uncertainty.motion_plan import PlannedMotion
from jointid.uncertainty.planned_records import PlannedRecords, planned_records

LONGEST_S = 600.0
"""Longest experiment that is simulated and written."""
_FEWEST_PERIODS = 8
"""Fewest periods at full amplitude: the first ones settle, and a segment needs five steady ones."""
_SAMPLES = 20
"""Samples of a motion per period of its highest frequency."""
_LINE_SPACING = 3
"""Smallest distance of the lines of a multisine, over the inverse of its length."""


def planned_experiment(
    plan: PlannedRecords | PlannedMotion,
    inertia: Inertia,
    elasticity: Elasticity,
    *,
    kind: str = "sines",
    repeats: int = 1,
    ramp_s: float = 0.5,
    rest_s: float = 1.0,
    velocity_rad_s: ArrayLike = 0.0,
    scale: float = 1.0,
) -> Experiment:
    """Make an experiment of planned records.

    The plan holds r sines of n joints, or another motion, which ignores ``kind``. Its model, inertia and
    elasticity, limits the torques of multisines and sweeps to those of the plan. A ``kind`` "multisine"
    holds all frequencies that lie apart; records with a frequency in common go to further multisines. A
    "sweep" from the lowest to the highest frequency is made n times, each with other phases between the
    joints. ``ramp_s`` is the length of the ramps, at least one period of the lowest frequency of a run,
    ``rest_s`` the rest before, between and after the runs. With a superposed velocity of the motors,
    ``velocity_rad_s``, one or (n,), every run is made twice, forward and back. ``scale`` is a factor on
    all amplitudes and on that velocity. Raises JointIdError when a setting is out of range or the
    experiment too long.
    """
    repeats = whole_number("repeats", repeats, 1, 100)
    ramp_s, rest_s = bounded_number("ramp_s", "s", ramp_s), bounded_number("rest_s", "s", rest_s)
    scale = bounded_number("scale", "", scale)
    if kind not in KINDS:
        raise JointIdError(
            f'"{kind}" is not a way to run planned sines: choose one of {", ".join(KINDS)}.'
        )
    if isinstance(plan, PlannedMotion):
        contents = list(_motions(plan, ramp_s))
    else:
        contents = list(_MAKERS[kind](plan, inertia, elasticity))
    drift = scale * per_joint("velocity_rad_s", velocity_rad_s, inertia.n)
    ways = ((", forward", 1), (", back", -1)) if drift.any() else (("", 1),)
    runs = []
    for repeat, run, (way, sign) in product(range(1, repeats + 1), contents, ways):
        runs.append(
            replace(
                run,
                label=run.label + (f", repeat {repeat}" if repeats > 1 else "") + way,
                angle_rad=scale * run.angle_rad,
                ramp_s=max(ramp_s, 1 / float(run.frequency_hz.min())),
                velocity_rad_s=sign * drift,
            )
        )
    experiment = Experiment(tuple(runs), rest_s, scale)
    if experiment.duration_s > LONGEST_S:
        raise JointIdError(
            f"The experiment lasts {experiment.duration_s:.0f} s; the limit is {LONGEST_S:g} s: "
            "use fewer or shorter records in one file, or fewer repeats."
        )
    return experiment


def _sines(plan: PlannedRecords, *_: object) -> Iterator[Run]:
    each = zip(plan.frequency_hz, plan.angle_rad, plan.duration_s, strict=True)
    for number, (frequency, angle, duration) in enumerate(each, start=1):
        hold = float(np.ceil(max(duration * frequency - 1e-9, _FEWEST_PERIODS)) / frequency)
        label = f"record {number} ({frequency:.4g} Hz)"
        yield Run(label, np.array([frequency]), angle[None], hold)


def _multisines(plan: PlannedRecords, *_: object) -> Iterator[Run]:
    length = max(float(plan.duration_s.max()), _FEWEST_PERIODS / float(plan.frequency_hz.min()))
    lines = plan.frequency_hz * length
    rank = np.minimum(np.rint(lines), np.floor(lines.max() + 1e-9)).astype(int)
    groups: list[list[int]] = []
    for k in np.argsort(plan.frequency_hz, kind="stable").tolist():
        apart = (g for g in groups if rank[k] - rank[g[-1]] >= _LINE_SPACING)
        group = next(apart, None)
        groups.append([k]) if group is None else group.append(k)
    for number, group in enumerate(groups, start=1):
        frequency, count = rank[group] / length, len(group)
        # Phases by Schroeder (1970) keep the peaks of the sum low.
        turn = np.exp(-1j * np.pi * np.arange(count) * np.arange(1, count + 1) / count)[:, None]
        angle, torque = plan.angle_rad[group] * turn, plan.torque_Nm[group] * turn
        time = np.arange(0, length, 1 / (16 * frequency.max()))
        wave = np.exp(2j * np.pi * time[:, None] * frequency)
        speed = 2j * np.pi * frequency[:, None] * angle
        share = min(
            _room(np.abs(plan.velocity_rad_s), (wave @ speed).imag),
            _room(np.abs(plan.torque_Nm), (wave @ torque).imag),
        )
        label = f"multisine {number} ({frequency[0]:.4g} to {frequency[-1]:.4g} Hz)"
        yield Run(label, frequency, share * angle, length)


def _sweeps(plan: PlannedRecords, inertia: Inertia, elasticity: Elasticity) -> Iterator[Run]:
    first, last = float(plan.frequency_hz.min()), float(plan.frequency_hz.max())
    if last < 1.2 * first:
        raise JointIdError(
            f"A sweep from {first:.4g} to {last:.4g} Hz is too narrow: plan records of at least two "
            "frequencies that differ by 20 %, or choose sines."
        )
    n, speed = plan.angle_rad.shape[1], plan.velocity_rad_s.max(axis=0)
    frequency = np.geomspace(first, last, 200)
    for number in range(n):
        pattern = np.exp(2j * np.pi * number * np.arange(n) / n) * speed / (2 * np.pi)
        grid = planned_records(
            inertia,
            elasticity,
            frequency,
            angle_rad=pattern / frequency[:, None],
            duration_s=2 / first,
        )
        share = _room(np.abs(plan.torque_Nm), np.abs(grid.torque_Nm))
        label = f"sweep {number + 1} ({first:.4g} to {last:.4g} Hz)"
        angle = share * pattern[None] / first
        yield Run(label, np.array([first]), angle, float(plan.duration_s.max()), last_hz=last)


_MAKERS: dict[str, Callable[..., Iterator[Run]]] = {
    "sines": _sines,
    "multisine": _multisines,
    "sweep": _sweeps,
}
KINDS = tuple(_MAKERS)
"""One run per record; all records at once; all frequencies one after the other."""


def _motions(plan: PlannedMotion, ramp_s: float) -> Iterator[Run]:
    """The motion of each record; its first and last parts are the ramps."""
    motion, n = plan.motion, plan.records[0].n
    interval = min(1e-3, 1 / (_SAMPLES * motion.to_hz))
    before = round(max(ramp_s, 1 / motion.from_hz) / interval)
    hold = motion.duration_s - before * interval
    if hold <= 0:
        raise JointIdError(f"Ramps of {before * interval:g} s are longer than the motion: shorten them.")
    reference = sampled(motion, n, len(plan.records), interval, before, 0)
    time = interval * np.arange(-1, len(reference.position) - 1)
    for number in range(len(plan.records)):
        label = f"{motion.kind} {number + 1} ({motion.from_hz:.4g} to {motion.to_hz:.4g} Hz)"
        wave = make_interp_spline(time, reference.position[:, :, number], k=5)
        first, one = np.array([motion.from_hz]), np.ones(1, complex)
        yield Run(label, first, one, hold, last_hz=motion.to_hz, wave=wave)


def _room(allowed: Floats, used: Floats) -> float:
    """Factor up to 1 that limits the largest values used to those allowed, both (…, n)."""
    most, now = allowed.max(axis=0), np.abs(used).max(axis=0)
    return float(np.min(most[now > 0] / now[now > 0], initial=1.0))
