"""Nonlinear gears: identified laws, their values, and how often a linear robot is called nonlinear.

    python -m benchmarks.gears [runs] [table ...] [row ...]     or  python -m benchmarks gears

Tables: hardening, slopes, backlash, hysteresis, combined, linear; without a name all of them, and
without names of rows, such as "2 %", all rows. The robots are those of ``independent_robot``; plants,
noise (0.1 to 3 % of the torque) and errors of the given inertias change from run to run. The law acts at
one joint or at all. The last row of a table pools its intervals: their share that contains the true
value, and the probability of a share so far from 95 %.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import binomtest

from benchmarks.harness import Cell, Table, written
from benchmarks.independent_robot import Array, Robot, simulate
from benchmarks.real_robots import PERFECT, Campaign, Case, Loads, rubbing
from benchmarks.whole_error import NORMAL_95, Outcome, alarms, frequent, outcome
from jointid import Gear, Study, extract_phasors, identify_elasticity

Row = dict[str, Cell]
FIELDS = {"cubic": "cubic", "backlash_rad": "backlash_rad", "hysteresis_Nm": "hysteresis_Nm"}
"""Field of ``Gear`` for the law's field of the simulated robot."""
NAMES = {
    "knee_rad": "piecewise",
    "cubic": "hardening",
    "backlash_rad": "backlash",
    "hysteresis_Nm": "hysteresis",
}


def hardening(share: float) -> dict[str, Callable[[Robot, Loads], Array]]:
    """Additional torque at the peak deflection, over the linear one."""
    return {"cubic": lambda robot, loads: share * robot.K / loads.deflection**2}


def backlash(share: float) -> dict[str, Callable[[Robot, Loads], Array]]:
    """Total play over the peak-to-peak deflection."""
    return {"backlash_rad": lambda robot, loads: share * 2 * loads.deflection}


def slopes(*knees: tuple[float, float]) -> dict[str, Callable[[Robot, Loads], Array]]:
    """Slopes over K beyond shares of the peak deflection, one or two pairs of share and slope."""
    found: dict[str, Callable[[Robot, Loads], Array]] = {}
    for (share, ratio), at, slope in zip(
        knees, ("knee_rad", "second_knee_rad"), ("knee_slope", "second_slope"), strict=False
    ):
        found[at] = lambda robot, loads, share=share: share * loads.deflection
        found[slope] = lambda robot, loads, ratio=ratio: np.full(robot.n, ratio)
    return found


def dahl(share: float, presliding: float = 0.03) -> dict[str, Callable[[Robot, Loads], Array]]:
    """Level over the peak torque, presliding over the peak deflection."""
    return {
        "hysteresis_Nm": lambda robot, loads: share * loads.torque,
        "hysteresis_rad": lambda robot, loads: presliding * loads.deflection,
    }


@dataclass(frozen=True)
class GearCase:
    """Laws, with friction over the smallest torque, joints and amplitudes."""

    laws: Mapping[str, Callable[[Robot, Loads], Array]]
    rub: float = 0.0
    joints: int = 2
    one: bool = False
    """Whether only joint 1 has the laws."""
    motions: Mapping[str, Any] | None = None
    noise: float | None = None
    """Of the torque over its amplitude; drawn between 0.1 and 3 % when None."""
    step_s: float = 8e-5
    """Longest step of the simulation with hysteresis: a fraction of presliding over velocity."""

    @property
    def case(self) -> Case:
        def change(robot: Robot, loads: Loads) -> dict[str, Any]:
            values = {name: law(robot, loads) for name, law in self.laws.items()}
            if self.one:
                first = np.arange(robot.n) == 0
                values = {
                    name: np.where(first | (name == "hysteresis_rad"), value, 0.0)
                    for name, value in values.items()
                }
            return (rubbing(self.rub, viscous=0.04)(robot, loads) if self.rub else {}) | values

        fine = {"max_step_s": self.step_s} if "hysteresis_Nm" in self.laws else {}
        return Case(change=change, joints=self.joints, motions=fine | (self.motions or {}))


def true_gear(robot: Robot, j: int) -> Gear:
    law = {field: float(getattr(robot, name)[j]) for name, field in FIELDS.items()}
    K, knee = float(robot.K[j]), float(robot.knee_rad[j])
    if knee:
        K2, T1 = K * float(robot.knee_slope[j]), K * knee
        second = float(robot.second_knee_rad[j])
        K3 = K * float(robot.second_slope[j]) if second else K2
        T2 = T1 + K2 * (second - knee) if second else T1
        law |= {"K2": K2, "K3": K3, "T1_Nm": T1, "T2_Nm": T2}
    return Gear(K=K, presliding_rad=float(robot.hysteresis_rad[j]), **law)


@dataclass(frozen=True, eq=False)
class Found:
    """One analysis against the truth."""

    outcome: Outcome
    robot: Robot

    @property
    def gears(self) -> tuple[Gear, ...]:
        assert self.outcome.analysis is not None
        return self.outcome.analysis.fit.gears

    def kinds_right(self) -> bool:
        """Whether every joint has exactly its laws."""
        wanted = [
            {name for field, name in NAMES.items() if getattr(self.robot, field)[j]} or {"linear"}
            for j in range(self.robot.n)
        ]
        return [set(gear.laws) for gear in self.gears] == wanted

    def torque_error(self) -> float:
        """Largest error of the laws' torque over the range tried, over its peak."""
        worst = 0.0
        for j, gear in enumerate(self.gears):
            delta = np.linspace(-gear.tried_rad, gear.tried_rad, 201)
            true = true_gear(self.robot, j).torque(delta)
            worst = max(worst, float(np.abs(gear.torque(delta) - true).max() / np.abs(true).max()))
        return worst

    def error(self, field: str) -> float:
        """Largest relative error of a law's value over the joints that have it."""
        true = getattr(self.robot, field)
        got = np.array([getattr(gear, FIELDS[field]) for gear in self.gears])
        return float(np.abs(got / np.where(true, true, np.inf) - 1)[true != 0].max())


def found(made: GearCase, runs: int) -> list[Found]:
    campaigns = [made.case.campaign(run, noise=made.noise) for run in range(runs)]
    logs = simulate([(each.robot, each.experiment) for each in campaigns])
    studies = [each.study(records) for each, records in zip(campaigns, logs, strict=True)]
    return [
        Found(outcome(study, each.robot.answer), each.robot)
        for study, each in zip(studies, campaigns, strict=True)
    ]


COLUMNS = {
    "gears": "", "runs": ".0f", "laws right": ".0f", "error of backlash, largest, %": ".1f",
    "error of hysteresis, largest, %": ".1f", "error of torque, largest, %": ".2f",
    "error of K, largest, %": ".2f", "error of D, largest, %": ".2f",
    "error of K, largest, σ": ".1f", "error of D, largest, σ": ".1f",
    "truth within 95 %, %": ".1f", "p": ".3f",
    "silently wrong": ".0f", "with a warning": ".0f", "within the target": ".0f",
    "CPU, median, s": ".2f", "CPU, largest, s": ".2f", "models": "", "warnings": "",
}  # fmt: skip
AIMS = {"backlash_rad": 0.10, "hysteresis_Nm": 0.15}
"""Largest relative error of a law's value; the torque has 1 % of its peak, K and D 3 stated errors."""


def in_aim(each: Found, laws: Mapping[str, Any]) -> bool:
    """Whether laws, their torque, K and D are within the required errors."""
    near = all(each.error(name) < AIMS[name] for name in laws if name in AIMS)
    exact = each.torque_error() < 0.01 and float(np.abs(each.outcome.z).max()) < 3
    return near and exact and each.kinds_right()


def intervals(z: Array) -> Row:
    """Coverage of the 95 % intervals, and the probability of a share so far from 95 % by chance."""
    held = int((z <= NORMAL_95).sum())
    return {
        "truth within 95 %, %": 100 * held / z.size,
        "p": float(binomtest(held, z.size, 0.95).pvalue),
    }


def row(name: str, made: GearCase, runs: int) -> tuple[Row, Array]:
    """One row of a table, and the errors of K and D in stated ones."""
    every = found(made, runs)
    good = [each for each in every if each.outcome.analysis is not None]
    n = made.joints

    def most(law: str) -> float | None:
        return max((100 * each.error(law) for each in good), default=None) if law in made.laws else None

    z = np.abs([each.outcome.z for each in every])
    error = 100 * np.abs([each.outcome.error for each in good])
    cpu = [each.outcome.cpu_s for each in every]
    cells = {
        "gears": name,
        "runs": runs,
        "laws right": sum(each.kinds_right() for each in good),
        "error of backlash, largest, %": most("backlash_rad"),
        "error of hysteresis, largest, %": most("hysteresis_Nm"),
        "error of torque, largest, %": 100 * max((each.torque_error() for each in good), default=np.nan),
        "error of K, largest, %": float(error[:, :n].max()),
        "error of D, largest, %": float(error[:, n:].max()),
        "error of K, largest, σ": float(z[:, :n].max()),
        "error of D, largest, σ": float(z[:, n:].max()),
        **intervals(z),
        "silently wrong": sum(each.outcome.silent_wrong for each in every),
        "with a warning": sum(bool(each.outcome.alarms) for each in every),
        "within the target": sum(in_aim(each, made.laws) for each in good),
        "CPU, median, s": float(np.median(cpu)),
        "CPU, largest, s": max(cpu),
        "models": frequent((each.outcome.model for each in every), 3),
        "warnings": alarms([each.outcome for each in every]),
    }
    return cells, z


TWO = {"levels": (1.0, 0.5)}
HARDENING = {f"{s} %": GearCase(hardening(s / 100)) for s in (5, 20, 50, 100)} | {
    "20 % at joint 1": GearCase(hardening(0.2), one=True),
    "−5 % (softening)": GearCase(hardening(-0.05)),
    "20 %, friction": GearCase(hardening(0.2), rub=0.1),
    "20 %, three joints": GearCase(hardening(0.2), joints=3),
}
SLOPES = {
    "1.3 times beyond 40 %": GearCase(slopes((0.4, 1.3))),
    "2 times beyond 40 %": GearCase(slopes((0.4, 2.0))),
    "2 times beyond 20 %": GearCase(slopes((0.2, 2.0))),
    "1.4 beyond 25 %, 2 beyond 60 %": GearCase(slopes((0.25, 1.4), (0.6, 2.0))),
    "1.3 beyond 30 %, 1.6 beyond 70 %, friction": GearCase(slopes((0.3, 1.3), (0.7, 1.6)), rub=0.1),
    "1.5 times beyond 70 %, friction": GearCase(slopes((0.7, 1.5)), rub=0.1),
    "1.1 beyond 40 %, 1.25 beyond 70 %, noise 3 %": GearCase(
        slopes((0.4, 1.1), (0.7, 1.25)), noise=0.03
    ),
}
BACKLASH = {f"{s} %": GearCase(backlash(s / 100)) for s in (0.3, 1, 3, 10, 30)} | {
    "3 % at joint 1": GearCase(backlash(0.03), one=True),
    "3 %, friction": GearCase(backlash(0.03), rub=0.1),
    "3 %, two amplitudes": GearCase(backlash(0.03), motions=TWO),
    "30 %, friction": GearCase(backlash(0.3), rub=0.1),
}
HYSTERESIS = {f"{s} %": GearCase(dahl(s / 100)) for s in (0.5, 2, 5, 10)} | {
    "2 %, presliding 0.5 %": GearCase(dahl(0.02, 0.005), step_s=2e-5),
    "2 %, presliding 10 %": GearCase(dahl(0.02, 0.1)),
    "2 % at joint 1": GearCase(dahl(0.02), one=True),
    "2 %, friction": GearCase(dahl(0.02), rub=0.1),
    "2 %, two amplitudes": GearCase(dahl(0.02), motions=TWO),
    "10 %, friction": GearCase(dahl(0.1), rub=0.1),
}
COMBINED = {
    "hardening 30 %, Dahl 3 %": GearCase(hardening(0.3) | dahl(0.03)),
    "the same, friction": GearCase(hardening(0.3) | dahl(0.03), rub=0.1),
    "the same, two amplitudes": GearCase(hardening(0.3) | dahl(0.03), motions=TWO),
    "backlash 3 %, Dahl 3 %": GearCase(backlash(0.03) | dahl(0.03)),
    "the same, friction ": GearCase(backlash(0.03) | dahl(0.03), rub=0.1),
    "hardening 30 %, backlash 3 %": GearCase(hardening(0.3) | backlash(0.03)),
    "four joints, hardening 30 %": GearCase(hardening(0.3), joints=4),
}


POOLED = "runs", "laws right", "silently wrong", "with a warning", "within the target"


Made = Callable[[int, Sequence[str]], Iterator[Row]]
"""Rows of a table by the number of runs and their names; without names all of them."""


def rows(cases: Mapping[str, GearCase]) -> Made:
    def made(runs: int, only: Sequence[str]) -> Iterator[Row]:
        cells, sizes = [], []
        for name in only or cases:
            one, z = row(name, cases[name], runs)
            cells.append(one)
            sizes.append(z.ravel())
            yield one
        sums = {name: sum(float(one[name] or 0) for one in cells) for name in POOLED}
        yield {"gears": "all"} | sums | intervals(np.concatenate(sizes))

    return made


LINEAR = {
    "no friction": Case(),
    "friction, 10 %": PERFECT["mild friction"],
    "friction, 50 %": Case(change=rubbing(0.5, viscous=0.04)),
    "two amplitudes": Case(motions=TWO),
    "three joints": Case(joints=3),
}
DESIGNED = 0.005
"""Rate at which linear robots may be called nonlinear."""
LINEAR_COLUMNS = {
    "linear robots": "", "runs": ".0f", "called nonlinear": ".0f", "p of 0.5 %": ".3f",
    "truth within 95 %, %": ".1f", "p": ".3f",
    "CPU, auto, s": ".2f", "CPU, linear, s": ".2f", "ratio, median": ".2f", "ratio, largest": ".2f",
}  # fmt: skip


def linear_row(name: str, case: Case, runs: int) -> Row:
    called, times, spent, sizes = 0, [], [], []
    for first in range(0, runs, 16):
        part = [case.campaign(run) for run in range(first, min(first + 16, runs))]
        logs = simulate([(each.robot, each.experiment) for each in part])
        for each, records in zip(part, logs, strict=True):
            fits, cpu = timed(each, records)
            called += any(gear.kind != "linear" for gear in fits[0].gears)
            z = (np.concatenate([fits[0].K, fits[0].D]) - each.robot.answer) / fits[0].standard_error
            sizes.append(np.abs(z))
            spent.append(cpu)
            times.append(cpu[0] / cpu[1])
    auto, linear = np.median(spent, axis=0)
    return {
        "linear robots": name,
        "runs": runs,
        "called nonlinear": called,
        "p of 0.5 %": float(binomtest(called, runs, DESIGNED, alternative="greater").pvalue),
        **intervals(np.array(sizes)),
        "CPU, auto, s": float(auto),
        "CPU, linear, s": float(linear),
        "ratio, median": float(np.median(times)),
        "ratio, largest": max(times),
    }


def timed(campaign: Campaign, records: list[Any]) -> tuple[list[Any], list[float]]:
    """Fits with gear="auto" and "linear", and their CPU times."""
    study: Study = campaign.study(records)
    phasors, fits, cpu = extract_phasors(study.records), [], []
    for gear in ("auto", "linear"):
        begin = time.process_time()
        fits.append(identify_elasticity(phasors, study.inertia, inertia_std=0.05, gear=gear))
        cpu.append(time.process_time() - begin)
    return fits, cpu


def linear_rows(runs: int, only: Sequence[str]) -> Iterator[Row]:
    for name in only or LINEAR:
        yield linear_row(name, LINEAR[name], runs)


TABLES: dict[str, tuple[str, Mapping[str, str], Made]] = {
    "hardening": (
        "Hardening, torque at the peak deflection over the linear one",
        COLUMNS,
        rows(HARDENING),
    ),
    "slopes": ("Two and three slopes", COLUMNS, rows(SLOPES)),
    "backlash": ("Backlash, play over the peak-to-peak deflection", COLUMNS, rows(BACKLASH)),
    "hysteresis": ("Dahl hysteresis, level over the peak torque", COLUMNS, rows(HYSTERESIS)),
    "combined": ("Several laws", COLUMNS, rows(COMBINED)),
    "linear": ("Linear robots", LINEAR_COLUMNS, linear_rows),
}


def measure(quick: bool) -> Iterator[Table]:
    """Return the tables for ``python -m benchmarks gears``."""
    for name, (title, columns, made) in TABLES.items():
        yield Table(f"gears, {name}", title, columns, tuple(made(1 if quick else 16, ())))


def main(arguments: Sequence[str]) -> None:
    """Print tables row by row, each as soon as it is measured."""
    runs = int(arguments[0]) if arguments else 16
    only = [name for name in arguments[1:] if name not in TABLES]
    for name in arguments[1 : len(arguments) - len(only)] or TABLES:
        title, columns, made = TABLES[name]
        print(f"\n{Table(name, title, columns, ()).markdown()}", flush=True)
        for each in made(runs, only):
            cells = (written(each.get(column), form) for column, form in columns.items())
            print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
