"""A robot that changes from record to record: which changes cause a warning, and whether K and D hold.

    python -m benchmarks.changing_robot [runs, 4] [change ...]

The robots are those of ``independent_robot``, with Coulomb and viscous friction; the records follow in
order of frequency, as in most campaigns. Where K or D changes, its mean over the records is the truth. A
run is silently wrong if K or D is off by more than four stated standard errors and no finding is a
warning or a problem.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.harness import Table
from benchmarks.independent_robot import Robot, simulate
from benchmarks.log_faults import COLUMNS, row
from benchmarks.real_robots import Case, rubbing
from benchmarks.whole_error import Outcome, outcome

Change = Callable[[Robot, float, np.random.Generator], dict[str, Any]]
"""Fields of the robot in one record, at a share from 0 to 1 of the campaign."""


def _friction(of_share: Callable[[float], float] = lambda _: 1.0, scatter: float = 0.0) -> Change:
    """Coulomb and viscous friction times a factor."""

    def change(robot: Robot, share: float, rng: np.random.Generator) -> dict[str, Any]:
        factor = max(of_share(share) + scatter * rng.standard_normal(), 0.1)
        return {"coulomb": factor * robot.coulomb, "viscous": factor * robot.viscous}

    return change


def _falling(name: str, by: float) -> Change:
    """A field that falls, with its mean unchanged."""
    return lambda robot, share, _: {name: getattr(robot, name) * (1 + by * (0.5 - share))}


def _warming_up(robot: Robot, share: float, _: np.random.Generator) -> dict[str, Any]:
    """Friction that falls by 30 %, D by 20 % and K by 1 %, most of it at first; the means stay."""
    done = float(np.exp(-3 * share) - np.exp(-3 * np.arange(36) / 35).mean()) / (1 - np.exp(-3))
    by = {"coulomb": 0.3, "viscous": 0.3, "D": 0.2, "K": 0.01}
    return {name: getattr(robot, name) * (1 + fall * done) for name, fall in by.items()}


def _is_eighth(share: float) -> bool:
    """Whether the share is that of the eighth of 36 records."""
    return abs(share - 7 / 35) < 1e-3


CHANGES: dict[str, Change] = {
    "none": lambda *_: {},
    "friction falls by 30 %": _friction(lambda share: 1 - 0.3 * share),
    "friction falls by 60 %": _friction(lambda share: 1 - 0.6 * share),
    "friction scatters by 1 %": _friction(scatter=0.01),
    "friction scatters by 10 %": _friction(scatter=0.1),
    "friction scatters by 30 %": _friction(scatter=0.3),
    "Coulomb friction alone falls by 30 %": _falling("coulomb", 0.3),
    "viscous friction alone falls by 50 %": _falling("viscous", 0.5),
    "K falls by 0.5 %": _falling("K", 0.005),
    "K falls by 2 %": _falling("K", 0.02),
    "D falls by 30 %": _falling("D", 0.3),
    "warming up": _warming_up,
    "M2 of the second half 5 % high": lambda robot, share, _: (
        {"M2": robot.M2 * (1.05 if share > 0.5 else 1.0)}
    ),
    "M2 of one record 20 % high": lambda robot, share, _: (
        {"M2": robot.M2 * 1.2} if _is_eighth(share) else {}
    ),
    "arm touches a spring in one record": lambda robot, share, _: (
        {"gravity": 0.1 * robot.K} if _is_eighth(share) else {}
    ),
    "torque late by 0 to 1 ms": lambda robot, _, rng: (
        {"lag_s": [1.25e-4 * int(rng.integers(0, 9))] * robot.n}
    ),
}


def measure(quick: bool) -> Iterator[Table]:
    """Outcomes of every change."""
    yield table(1 if quick else 4, ["none", "friction scatters by 10 %"] if quick else list(CHANGES))


def table(runs: int, names: Sequence[str]) -> Table:
    """A row for each change."""
    rows = tuple(row(name, [changed(name, run) for run in range(runs)]) for name in names)
    return Table("changing robot", "Robots that change from record to record", COLUMNS, rows)


def changed(name: str, run: int, *, share: float = 0.3) -> Outcome:
    """Outcome of a run; friction is ``share`` of the smallest torque."""
    made = Case(change=rubbing(share, viscous=0.04)).campaign(run, noise=0.005)
    every, rng, runs = made.experiment, np.random.default_rng([run, 55]), []
    count = every.frequency_hz.size
    for k in range(count):
        robot = replace(made.robot, **CHANGES[name](made.robot, k / (count - 1), rng))
        one = {
            field: getattr(every, field)[k : k + 1]
            for field in ("frequency_hz", "amplitude_rad", "phase_rad")
        }
        runs.append((robot, replace(every, **one, seed=1000 * every.seed + k)))
    return outcome(made.study([record for (record,) in simulate(runs)]), made.answer)


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 4
    print(table(count, sys.argv[2:] or list(CHANGES)).markdown())
