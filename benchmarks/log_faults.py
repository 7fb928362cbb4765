"""Faults of the log: which ones cause a warning, and whether an answer without one is right.

    python -m benchmarks.log_faults [runs, 4] [sines | motions] [fault ...]

The robots are those of ``independent_robot``, with and without Coulomb friction; every record of a run
has the fault. A run is silently wrong if K or D is off by more than four stated standard errors and no
finding is a warning or a problem.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from scipy.signal import lfilter

from benchmarks import motion
from benchmarks.harness import Cell, Table
from benchmarks.independent_robot import Array, simulate
from benchmarks.motion import CELL, Motion
from benchmarks.real_robots import Case, rubbing
from benchmarks.whole_error import Outcome, alarms, outcome
from jointid import MotionRecord, SineRecord, Study

Record = TypeVar("Record", SineRecord, MotionRecord)
Signals = tuple[Array, Array]
Fault = Callable[[Array, Array, Array, np.random.Generator], Signals]
"""Of angles and torques (N, n), with the largest torques (n,)."""
KINDS = "sines", "motions"
_COULOMB_NM = [0.25, 0.05]
"""Friction of the motors in motions."""


def _coloured(angle: Array, torque: Array, size: Array, rng: np.random.Generator) -> Signals:
    noise = lfilter([np.sqrt(1 - 0.95**2)], [1, -0.95], rng.standard_normal(torque.shape), axis=0)
    return angle, torque + 0.02 * size * noise


def _spikes(angle: Array, torque: Array, size: Array, rng: np.random.Generator) -> Signals:
    struck = torque.copy()
    struck[rng.integers(0, len(torque), 5)] += 5 * size * rng.choice([-1, 1], (5, 1))
    return angle, struck


def _second_late(samples: float) -> Fault:
    def fault(angle: Array, torque: Array, _: Array, __: np.random.Generator) -> Signals:
        place = np.arange(len(angle), dtype=float)
        moved = [x.copy() for x in (angle, torque)]
        for signal in moved:
            signal[:, 1] = np.interp(place - samples, place, signal[:, 1])
        return moved[0], moved[1]

    return fault


def _held(torque: Array, samples: int = 4) -> Array:
    return np.asarray(torque[np.arange(len(torque)) // samples * samples])


FAULTS: dict[str, Fault] = {
    "none": lambda angle, torque, *_: (angle, torque),
    "coloured noise, 2 % of the torque": _coloured,
    "five spikes": _spikes,
    "torque in steps of 5 %": lambda q, tau, size, _: (q, 0.05 * size * np.round(tau / size / 0.05)),
    "joint 2 late by a sample": _second_late(1.0),
    "joint 2 late by half a sample": _second_late(0.5),
    "torque held for four samples": lambda q, tau, *_: (q, _held(tau)),
    "angle held for four samples": lambda q, tau, *_: (_held(q), tau),
    "torque scale differs by 2 %": lambda q, tau, _, rng: (
        q, tau * (1 + 0.02 * rng.standard_normal(tau.shape[1]))
    ),
    "2 % of the other torque": lambda q, tau, *_: (q, tau + 0.02 * tau[:, ::-1]),
    "dead zone, 2 % of the torque": lambda q, tau, size, _: (
        q, np.sign(tau) * np.maximum(np.abs(tau) - 0.02 * size, 0)
    ),
    "torque 5 % low at its largest": lambda q, tau, size, _: (q, tau * (1 - 0.05 * (tau / size) ** 2)),
    "encoder error of 0.2 mrad, 64 periods per turn": lambda q, tau, *_: (
        q + 2e-4 * np.sin(64 * q),
        tau,
    ),
}  # fmt: skip


COLUMNS = {
    "fault": "", "runs": ".0f", "silently wrong": ".0f", "with a warning": ".0f",
    "largest silent error, σ": ".1f", "CPU, median, s": ".1f", "CPU, largest, s": ".1f", "warnings": "",
}  # fmt: skip


def measure(quick: bool) -> Iterator[Table]:
    """Outcomes of every fault, for sines and motions."""
    for kind in KINDS[:1] if quick else KINDS:
        yield table(1 if quick else 4, kind, ["none"] if quick else list(FAULTS))


def table(runs: int, kind: str, faults: Sequence[str]) -> Table:
    """A row for each fault."""
    studies = [each for run in range(runs) for each in _studies(run, kind)]
    rows = tuple(row(name, [_outcome(FAULTS[name], *each) for each in studies]) for name in faults)
    return Table(f"log faults, {kind}", f"Faults of the log, {kind}", COLUMNS, rows)


def _studies(run: int, kind: str) -> Iterator[tuple[Study, Array, int]]:
    """Without and with friction: study, true K and D, and run."""
    for rubs in (False, True):
        if kind == "sines":
            case = Case(change=rubbing(0.3, viscous=0.04)) if rubs else Case()
            made = case.campaign(run, noise=0.005)
            yield made.study(simulate([(made.robot, made.experiment)])[0]), made.answer, run
        else:
            rng = np.random.default_rng([run, 3])
            robot = replace(CELL, K=CELL.K * np.exp(rng.uniform(-0.3, 0.3, 2)))
            if rubs:
                robot = replace(robot, coulomb=np.array(_COULOMB_NM), viscous=np.array([0.002, 0.0004]))
            reference = ("random", "moves")[run % 2]
            made_by = Motion(reference, records=3, duration_s=12.0, seed=run)
            (records,) = motion.simulate([(robot, made_by)])
            yield Study(records, motion.given(robot, 0.02, rng), inertia_std=0.05), robot.answer, run


def _outcome(fault: Fault, study: Study, answer: Array, run: int) -> Outcome:
    size = np.max([np.abs(record.tau_Nm).max(axis=0) for record in study.records], axis=0)
    rng = np.random.default_rng([run, 77])

    def faulty(record: Record) -> Record:
        angle, torque = fault(record.theta_rad, record.tau_Nm, size, rng)
        return replace(record, theta_rad=angle, tau_Nm=torque)

    return outcome(replace(study, records=tuple(map(faulty, study.records))), answer)


def row(name: str, found: Sequence[Outcome]) -> dict[str, Cell]:
    """Row of a table of outcomes."""
    calm = [float(np.abs(each.z).max()) for each in found if not each.alarms]
    cpu = [each.cpu_s for each in found]
    return {
        "fault": name,
        "runs": len(found),
        "silently wrong": sum(each.silent_wrong for each in found),
        "with a warning": len(found) - len(calm),
        "largest silent error, σ": max(calm, default=None),
        "CPU, median, s": float(np.median(cpu)),
        "CPU, largest, s": max(cpu),
        "warnings": alarms(found),
    }


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 4
    for each in [sys.argv[2]] if len(sys.argv) > 2 else KINDS:
        print(table(count, each, sys.argv[3:] or list(FAULTS)).markdown(), flush=True)
