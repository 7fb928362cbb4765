"""K and D from any motion: sweeps, random motion, multisines and moves of simulated robots.

The robots are those of ``independent_robot``: closed loop, held torque, encoder steps, set-valued
friction. The data do not depend on ``jointid.simulation`` or on the equations of the fit.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from scipy.stats import binomtest

from benchmarks.harness import Table
from benchmarks.independent_robot import MAX_STEP_S, Plants, Robot, _Linear, _Nonlinear, gains
from jointid import Inertia, JointIdError, MotionRecord, Study, analyse

Array = np.ndarray

CELL = Robot(
    M=[0.0025, 0.0010],
    M2=[[0.004104, 0.000395], [0.000395, 0.001889]],
    K=[52.3, 6.1],
    D=[0.12, 0.012],
)
"""Two axes of a robot of the IRB-2400 class, motor side."""
MANUTEC = Robot(
    M=[0.0013, 0.0013, 0.0013],
    M2=[[0.004, 0.0, 0.0], [0.0, 0.002274, 0.003522], [0.0, 0.003522, 0.007068]],
    K=[43.0, 8.0, 58.0],
    D=[0.05, 0.01, 0.04],
)
"""Three axes after the Manutec r3: strongly coupled."""
SINGLE = Robot(M=[0.0006], M2=[[0.0014]], K=[9.0], D=[0.018])


@dataclass(frozen=True, eq=False)
class Motion:
    """Records of one robot: the references of all joints, and the sensors."""

    kind: str = "sweep"
    records: int = 2
    duration_s: float = 20.0
    sample_rate_hz: float = 1000.0
    band_hz: tuple[float, float] = (2.0, 40.0)
    velocity_rad_s: float = 6.0
    """Largest velocity of the references."""
    noise_Nm: float | None = None
    """Standard deviation of the logged torque; None: 1 % of its own."""
    encoder_counts: int = 65536
    declare_hold: bool = True
    seed: int = 0
    rest_s: float = 0.1
    """Longest rest between moves."""
    one_joint: int | None = None
    """Only this joint's reference moves."""
    warm_up_s: float = field(default=1.0)

    @property
    def samples(self) -> int:
        return round((self.duration_s + self.warm_up_s) * self.sample_rate_hz)


def references(motion: Motion, n: int) -> tuple[Array, Array]:
    """Angles and velocities, shape (samples, n, records)."""
    rng = np.random.default_rng([motion.seed, 7])
    t = np.arange(motion.samples) / motion.sample_rate_hz
    angle = np.zeros((t.size, n, motion.records))
    for joint in range(n):
        for record in range(motion.records):
            angle[:, joint, record] = _reference(motion, t, rng, joint, record)
    if motion.one_joint is not None:
        angle[:, np.arange(n) != motion.one_joint] = 0
    rate = np.gradient(angle, 1 / motion.sample_rate_hz, axis=0)
    largest = np.abs(rate).max(axis=0)
    size = motion.velocity_rad_s / np.where(largest > 0, largest, 1.0)
    size *= rng.uniform(0.7, 1.0, size.shape)
    return angle * size, rate * size


def _reference(motion: Motion, t: Array, rng: np.random.Generator, joint: int, record: int) -> Array:
    low, high = motion.band_hz
    if motion.kind == "sweep":  # constant velocity; joints against each other in every second record
        ratio = np.log(high / low)
        span = t[-1] * (1 - 0.03 * joint)
        turn = 2 * np.pi * low * span / ratio * np.expm1(ratio * np.minimum(t / span, 1.0))
        phase = np.pi * joint * record + 0.5 * joint + rng.uniform(-0.4, 0.4)
        return np.sin(turn + phase) * np.exp(-ratio * t / span)
    if motion.kind == "random":
        lines = np.fft.rfftfreq(t.size, 1 / motion.sample_rate_hz)
        inside = (lines >= low) & (lines <= high)
        shape = rng.standard_normal(lines.size) + 1j * rng.standard_normal(lines.size)
        return np.fft.irfft(np.where(inside, shape / np.maximum(lines, low), 0), t.size)
    if motion.kind == "multisine":
        lines = np.arange(np.ceil(low / 0.2), np.floor(high / 0.2) + 1, 2) * 0.2
        phases = rng.uniform(0, 2 * np.pi, lines.size)
        return (np.sin(2 * np.pi * t[:, None] * lines + phases) / lines).sum(axis=1)
    if motion.kind == "moves":  # point to point, with rests
        out, at, k = np.zeros(t.size), 0.0, 0
        while k < t.size:
            length = rng.uniform(0.05, 0.35)
            m = max(2, round(length * motion.sample_rate_hz))
            x = np.linspace(0, 1, m)
            step = rng.uniform(-1, 1) * length - 0.3 * at
            part = at + step * x**3 * (10 - 15 * x + 6 * x * x)
            out[k : k + m] = part[: t.size - k]
            at, k = at + step, k + m
            rest = round(rng.uniform(0.0, motion.rest_s) * motion.sample_rate_hz)
            out[k : k + rest] = at
            k += rest
        return out
    raise ValueError(motion.kind)


def simulate(runs: Sequence[tuple[Robot, Motion]]) -> list[list[MotionRecord]]:
    """Records of all runs; robot and sample rate are the same in all."""
    robot, first = runs[0]
    if any(other is not robot for other, _ in runs):
        raise ValueError("runs: expected the same robot in all; simulate other robots one by one.")
    plants, n = Plants([robot]), robot.n
    targets, rates = zip(*(references(motion, n) for _, motion in runs), strict=True)
    target, rate = np.concatenate(targets, axis=2), np.concatenate(rates, axis=2)
    samples, _, columns = target.shape
    late = bool(plants.of("lag_s").any())
    exact = plants.linear and not late  # in one step a sample
    sub = 1 if exact else int(np.ceil(1 / first.sample_rate_hz / MAX_STEP_S - 1e-9))
    lag = np.rint(plants.of("lag_s")[0] * first.sample_rate_hz * sub).astype(int)
    step_s = 1 / first.sample_rate_hz / sub
    advance = _Linear(plants, step_s) if plants.linear else _Nonlinear(plants, step_s, columns)
    x = advance.start() if isinstance(advance, _Nonlinear) else np.zeros((1, plants.size, columns))
    counts = np.concatenate([[m.encoder_counts] * m.records for _, m in runs]).astype(float)
    quantum = np.where(counts > 0, 2 * np.pi / np.maximum(counts, 1), 1e-15)
    gain, damping = (each[:, None] for each in gains(robot))
    angles, torques = np.zeros((2, samples, n, columns))
    for k in range(samples):
        angles[k] = np.rint(plants.measured(x)[0] / quantum) * quantum
        torques[k] = gain * (target[k] - angles[k]) + damping * (rate[k] - x[0, plants.at["omega"]])
        for part in range(sub):
            held = torques[k]
            if late:
                held = torques[np.maximum((k * sub + part - lag[:, 0]) // sub, 0), np.arange(n)]
            x = advance(x, held[None])
    found, column = [], 0
    for _, motion in runs:
        rng, records = np.random.default_rng([motion.seed, 1]), []
        begin = round(motion.warm_up_s * motion.sample_rate_hz)
        for k in range(column, column + motion.records):
            tau = torques[begin:, :, k]
            size = 0.01 * tau.std() if motion.noise_Nm is None else motion.noise_Nm
            records.append(
                MotionRecord(
                    time_s=np.arange(len(tau)) / motion.sample_rate_hz,
                    theta_rad=angles[begin:, :, k],
                    tau_Nm=tau + size * rng.standard_normal(tau.shape),
                    torque_hold=motion.declare_hold,
                    label=f"{motion.kind} {k - column + 1}",
                )
            )
        column += motion.records
        found.append(records)
    return found


FRICTION = {
    "none": {},
    "0.05/0.01 N·m": {"coulomb": [0.05, 0.01], "viscous": [0.002, 0.0004]},
    "0.4/0.08 N·m": {"coulomb": [0.4, 0.08], "viscous": [0.002, 0.0004]},
    "presliding": {"coulomb": [0.1, 0.02], "viscous": [0.002, 0.0004], "presliding_rad": 5e-3},
    "at the arm": {"arm_coulomb": [0.03, 0.006]},
}
PRIORS = {"exact": 0.0, "5 %": 0.05, "unknown": np.inf}


def measure(quick: bool) -> Iterator[Table]:
    """Errors, intervals and warnings by motion, friction and knowledge of the inertias."""
    yield cells(1 if quick else 20, ["none"] if quick else ())
    yield others(quick)


def given(robot: Robot, std: float, rng: np.random.Generator) -> Inertia:
    """Inertias as wrong as they are uncertain; unknown ones by a quarter."""
    size = std if np.isfinite(std) else 0.25
    M = robot.M * (1 + size * rng.uniform(-1, 1, robot.n))
    scale = np.sqrt(1 + size * rng.uniform(-1, 1, robot.n))
    return Inertia(M, robot.M2 * np.outer(scale, scale))


FIGURES = {
    "error of K, %": ".2g", "error of D, %": ".2g", "σ of K, %": ".2g", "σ of D, %": ".2g",
    "truth within 95 %": "", "p": ".2g", "largest error, σ": ".2g", "misfit": ".2g", "CPU, s": ".2g",
    "with a warning": ".0f", "silent": ".0f", "refused": ".0f",
}  # fmt: skip
"""Largest errors, medians of the stated ones, and counts of the realisations: first those with the truth
within the 95 % interval, of K1 ... Kn, D1 ... Dn, with the probability p of so unlikely a count."""
_BATCH = 20
"""Realisations that are simulated at once."""


def cells(realisations: int, wanted: Sequence[str] = ()) -> Table:
    """The two-axis cell, two records of 20 s at 1 kHz, and the coverage of the 95 % intervals.

    ``wanted`` names kinds of friction, motion and knowledge of the inertias; by default all. Within a
    row, the realisations alternate between the kinds of knowledge.
    """
    axes = FRICTION, ("sweep", "random"), PRIORS
    frictions, kinds, priors = ([x for x in axis if x in wanted] or list(axis) for axis in axes)
    rows = []
    for name, kind in product(frictions, kinds):
        robot = replace(CELL, **FRICTION[name])
        found: list[Outcome | None] = []
        draws = np.random.default_rng(5)
        for first in range(0, realisations, _BATCH):
            seeds = range(first, min(first + _BATCH, realisations))
            logs = simulate([(robot, Motion(kind, seed=seed)) for seed in seeds])
            for seed, records in zip(seeds, logs, strict=True):
                found.append(_outcome(robot, records, PRIORS[priors[seed % len(priors)]], draws))
        known = ", ".join(priors)
        rows.append({"motion": kind, "friction": name, "inertias": known, **_row(robot, found)})
        print(rows[-1], flush=True)
    title = f"Two records of 20 s at 1 kHz, {realisations} realisations"
    return Table("motion", title, _columns("friction", "inertias"), tuple(rows))


def others(quick: bool) -> Table:
    """Other robots, sample rates, encoders and motions; inertias known to 5 %."""
    cases = {
        "250 Hz, 2^12 counts": (CELL, Motion(sample_rate_hz=250, encoder_counts=4096)),
        "4 kHz, 2^20 counts": (CELL, Motion(sample_rate_hz=4000, encoder_counts=2**20)),
        "multisine": (CELL, Motion("multisine")),
        "point to point": (CELL, Motion("moves")),
        "point to point, long rests, 2^14 counts": (
            CELL,
            Motion("moves", encoder_counts=2**14, rest_s=1.0),
        ),
        "three axes, three records": (MANUTEC, Motion("random", records=3)),
        "one axis, one record": (SINGLE, Motion("random", records=1)),
    }
    rows = []
    for name, (robot, motion) in list(cases.items())[: 2 if quick else None]:
        records = simulate([(robot, motion)])
        found = [_outcome(robot, each, 0.05, np.random.default_rng(5)) for each in records]
        rows.append({"motion": name, **_row(robot, found)})
    return Table("motion", "Other robots and motions", _columns(), tuple(rows))


def turning(realisations: int = 2) -> Table:
    """Waves over the motor's turn, which motions of 0.1 rad of the motor do not show; inertias to 5 %.

    The ripple is relative to the largest torque, the transmission error to the deflection by it.
    """
    robot, rows = replace(CELL, coulomb=[0.02, 0.004], phase=[0.7, 2.1]), []
    runs = [Motion(velocity_rad_s=1.5, seed=seed) for seed in range(realisations)]
    logs = [record for log in simulate([(robot, run) for run in runs]) for record in log]
    torque = np.max([np.abs(record.tau_Nm).max(axis=0) for record in logs], axis=0)
    waves: dict[str, dict[str, Array]] = {
        "torque ripple of 2 %": {"ripple_Nm": 0.02 * torque},
        "transmission error of 10 %": {"transmission_rad": 0.1 * torque / robot.K},
    }
    for name, periods in product(waves, (6, 24)):
        changed = replace(robot, **waves[name], per_turn=periods)
        found = [
            _outcome(changed, log, 0.05, np.random.default_rng(5))
            for log in simulate([(changed, run) for run in runs])
        ]
        rows.append({"motion": f"sweeps, {name}, {periods} per turn", **_row(changed, found)})
    return Table("motion", "Sweeps of 0.1 rad of the motor", _columns(), tuple(rows))


def _columns(*more: str) -> dict[str, str]:
    return {"motion": "", **dict.fromkeys(more, ""), **FIGURES}


@dataclass(frozen=True)
class Outcome:
    """One study."""

    off: Array
    """Relative errors of K1 ... Kn, D1 ... Dn."""
    stated: Array
    """The stated standard errors."""
    misfit: float
    spent_s: float
    warned: bool


def _outcome(
    robot: Robot, records: list[MotionRecord], std: float, rng: np.random.Generator
) -> Outcome | None:
    begin = time.process_time()
    try:
        found = analyse(Study(records=records, inertia=given(robot, std, rng), inertia_std=std))
    except JointIdError as error:
        print(f"not identified: {error}")
        return None
    off, stated = np.abs(found.fit.estimate / robot.answer - 1), found.fit.standard_error / robot.answer
    spent = time.process_time() - begin
    return Outcome(off, stated, found.fit.misfit, spent, found.state != "usable")


def _row(robot: Robot, outcomes: Sequence[Outcome | None]) -> dict[str, float | str]:
    """Largest errors, medians of the stated ones, truth within the 95 % intervals, and warnings.

    A wrong answer, more than four standard errors off, without a warning is silent.
    """
    each = [outcome for outcome in outcomes if outcome is not None]
    if not each:
        return {"refused": len(outcomes)}
    off, stated = (np.array([getattr(outcome, name) for outcome in each]) for name in ("off", "stated"))
    z = off / stated
    within = np.count_nonzero(z < 1.96, axis=0).tolist()
    chance = min(1.0, len(within) * min(binomtest(k, len(each), 0.95).pvalue for k in within))
    wrong = (z > 4).any(axis=1)
    largest, usual = np.split(100 * off.max(axis=0), 2), np.split(100 * np.median(stated, axis=0), 2)
    figures = [
        *(part.max() for part in (*largest, *usual)),
        f"{' '.join(map(str, within))} of {len(each)}",
        chance,
        z.max(),
        max(outcome.misfit for outcome in each),
        np.median([outcome.spent_s for outcome in each]),
        sum(outcome.warned for outcome in each),
        sum(bool(bad) and not outcome.warned for bad, outcome in zip(wrong, each, strict=True)),
        len(outcomes) - len(each),
    ]
    return dict(zip(FIGURES, figures, strict=True))


if __name__ == "__main__":
    print(cells(int(sys.argv[1]), sys.argv[2:]).markdown())
