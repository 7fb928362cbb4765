"""Whether the answer can be believed: errors, error bars and warnings on an independent simulated robot.

    python -m benchmarks.whole_error [runs] [table ...]     or  python -m benchmarks whole_error

Tables: cases, others, perfect, inertias, sticking, speed; all of them without a name. The robots are those
of ``independent_robot``; plants, noise (0.1 to 3 % of the torque), and errors of the given inertias change
from run to run. A run is silent and wrong when K or D is off by more than four stated standard errors
while no finding is a warning or a problem.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from scipy.stats import binomtest

from benchmarks.bound import bound
from benchmarks.harness import Cell, Table, rms
from benchmarks.independent_robot import Array, paper_motions, simulate
from benchmarks.real_robots import (
    MANUTEC, OTHERS, PAPER, PERFECT, STICKING, THIRTEEN, Campaign, Case, band, random_robot, wrong_inertia,
)  # fmt: skip
from jointid import Analysis, JointIdError, Study, analyse

SILENT = 4.0
"""Standard errors."""
NORMAL_95 = 1.95996
ALARM = ("warning", "problem")
AT_ONCE = 16
"""Studies that are simulated together, to bound the memory."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What an analysis said, against the truth."""

    z: Array
    """Errors of K and D in stated standard errors, shape (2n,)."""
    error: Array
    """Relative errors of K and D."""
    standard_error: Array
    """Relative, as stated."""
    alarms: tuple[str, ...]
    """Titles of warnings and problems; a refusal is one."""
    cpu_s: float
    analysis: Analysis | None = field(default=None, repr=False)

    @property
    def silent_wrong(self) -> bool:
        return not self.alarms and bool(np.any(~(np.abs(self.z) <= SILENT)))


def outcome(study: Study, answer: Array) -> Outcome:
    """Analyse a study and compare with the true K and D."""
    begin = time.process_time()
    try:
        analysis = analyse(study)
    except JointIdError as error:
        nothing = np.full(answer.size, np.nan)
        cpu_s = time.process_time() - begin
        return Outcome(np.zeros(answer.size), nothing, nothing, (f"refused: {error!s:.60}",), cpu_s)
    cpu_s = time.process_time() - begin
    fit = analysis.fit
    error = np.concatenate([fit.K, fit.D]) - answer
    return Outcome(
        z=error / fit.standard_error,
        error=error / answer,
        standard_error=fit.standard_error / answer,
        alarms=tuple(f.title for f in analysis.findings if f.level in ALARM),
        cpu_s=cpu_s,
        analysis=analysis,
    )


def outcomes(campaigns: Sequence[Campaign], **study: float) -> list[Outcome]:
    """Simulate and analyse every campaign."""
    found = []
    for first in range(0, len(campaigns), AT_ONCE):
        part = campaigns[first : first + AT_ONCE]
        logs = simulate([(each.robot, each.experiment) for each in part])
        for each, records in zip(part, logs, strict=True):
            found.append(outcome(each.study(records, **study), each.robot.answer))
    return found


def spoken(found: Iterable[Outcome], most: int = 3) -> str:
    """The most frequent warnings and problems, with counts."""
    counts = Counter(title for each in found for title in dict.fromkeys(each.alarms))
    return "; ".join(f"{count} × {title}" for title, count in counts.most_common(most))


CASE_COLUMNS = {
    "case": "", "runs": ".0f", "silent wrong": ".0f", "with alarm": ".0f", "95 % holds": ".0f",
    "median max |z|": ".1f", "largest silent |z|": ".1f", "K off, median %": ".2f", "D off, median %": ".2f",
    "CPU s, median": ".2f", "CPU s, most": ".2f", "model, most often": "", "findings": "",
}  # fmt: skip


def case_row(name: str, case: Case, runs: int, first: int = 0) -> dict[str, Cell]:
    found = outcomes([case.campaign(run) for run in range(first, first + runs)])
    calm = [float(np.abs(each.z).max()) for each in found if not each.alarms]
    cpu = [each.cpu_s for each in found]
    error = np.abs([each.error for each in found]).reshape(runs, 2, -1).max(axis=2)
    return {
        "case": f"{name}. {case.title}" if case.title else name,
        "runs": runs,
        "silent wrong": sum(each.silent_wrong for each in found),
        "with alarm": runs - len(calm),
        "95 % holds": 100 * float(held(found).mean()),
        "median max |z|": float(np.median([np.abs(each.z).max() for each in found])),
        "largest silent |z|": max(calm, default=None),
        "K off, median %": 100 * float(np.nanmedian(error[:, 0])),
        "D off, median %": 100 * float(np.nanmedian(error[:, 1])),
        "CPU s, median": float(np.median(cpu)),
        "CPU s, most": max(cpu),
        "model, most often": models(found),
        "findings": spoken(found),
    }


def held(found: Sequence[Outcome]) -> Array:
    """Whether the 95 % intervals hold the truth, shape (runs, 2n)."""
    return np.array([np.abs(each.z) <= NORMAL_95 for each in found])


def models(found: Sequence[Outcome], most: int = 2) -> str:
    """The models that were chosen most often, with counts."""
    counts = Counter(
        candidate.name
        for each in found
        if each.analysis is not None
        for candidate in each.analysis.fit.candidates
        if candidate.chosen
    )
    return "; ".join(f"{count} × {name}" for name, count in counts.most_common(most))


INERTIAS = {
    "up to 5 %": (0.05, 0.05, True),
    "up to 30 %": (0.30, 0.30, True),
    "up to 30 %, unknown": (0.30, np.inf, True),
    "up to 50 %, unknown": (0.50, np.inf, True),
    "normal, 5 %": (0.05, 0.05, False),
    "normal, 30 %": (0.30, 0.30, False),
}
"""Errors of the given inertias, ``inertia_std`` of the study, and whether the errors are uniform."""
ROBOTS = {"paper": PAPER, "Manutec": MANUTEC, "random": None}
INERTIA_COLUMNS = {
    "robot": "", "inertias": "", "runs": ".0f", "K rms %": ".3f", "D rms %": ".3f",
    "σ / bound, median": ".2f", "worst": ".2f", "rms error / bound": ".2f", "95 % holds": ".1f",
    "least p × cells": ".3f", "with alarm": ".0f", "CPU s, median": ".2f", "findings": "",
}  # fmt: skip


def inertia_row(robot: str, inertias: str, runs: int) -> tuple[dict[str, Cell], Array]:
    """A row of the table, and whether each interval held, shape (runs, 2n)."""
    error, std, uniform = INERTIAS[inertias]
    campaigns, bounds = [], []
    for run in range(runs):
        rng = np.random.default_rng([run, 5])
        plant = ROBOTS[robot] or random_robot(rng)
        experiment = paper_motions(plant, band(plant), seed=run, noise=0.01)
        M, M2 = wrong_inertia(plant, rng, error, uniform=uniform)
        campaigns.append(Campaign(plant, experiment, M, M2))
        bounds.append(bound(plant, experiment, M, M2, std) / plant.answer)
    found = outcomes(campaigns, inertia_std=std)
    holds = held(found)
    off = np.array([each.error for each in found]).reshape(runs, 2, -1)
    stated = np.array([each.standard_error for each in found]) / bounds
    cells = len(INERTIAS) * len(ROBOTS) * holds.shape[1]
    p = min(binomtest(int(column.sum()), runs, 0.95).pvalue for column in holds.T)
    row = {
        "robot": robot,
        "inertias": inertias,
        "runs": runs,
        "K rms %": 100 * rms(off[:, 0]),
        "D rms %": 100 * rms(off[:, 1]),
        "σ / bound, median": float(np.nanmedian(stated)),
        "worst": float(np.nanmax(np.nanmedian(stated, axis=0))),
        "rms error / bound": rms(off.reshape(runs, -1) / bounds),
        "95 % holds": 100 * float(holds.mean()),
        "least p × cells": min(1.0, p * cells),
        "with alarm": sum(bool(each.alarms) for each in found),
        "CPU s, median": float(np.median([each.cpu_s for each in found])),
        "findings": spoken(found),
    }
    return row, holds


def case_table(name: str, title: str, cases: Mapping[str, Case], runs: int) -> Iterator[tuple[str, ...]]:
    yield CASE_COLUMNS
    for key, case in cases.items():
        yield case_row(key, case, runs)


def main(arguments: Sequence[str]) -> None:
    runs = int(arguments[0]) if arguments else 50
    which = arguments[1:] or ["perfect", "cases", "others", "sticking", "inertias"]
    for name in which:
        print(f"\n### {name}", flush=True)
        if name == "inertias":
            print(Table("x", "x", INERTIA_COLUMNS, ()).markdown(), flush=True)
            for robot in ROBOTS:
                for inertias in INERTIAS:
                    row, _ = inertia_row(robot, inertias, runs)
                    print(Table("x", "x", INERTIA_COLUMNS, (row,)).markdown().splitlines()[-1], flush=True)
            continue
        cases = {"perfect": PERFECT, "cases": THIRTEEN, "others": OTHERS, "sticking": STICKING}[name]
        print(Table("x", "x", CASE_COLUMNS, ()).markdown(), flush=True)
        for key, case in cases.items():
            row = case_row(key, case, runs)
            print(Table("x", "x", CASE_COLUMNS, (row,)).markdown().splitlines()[-1], flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
