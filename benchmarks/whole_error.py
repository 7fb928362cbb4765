"""Errors, error bars and warnings of the answer on an independent simulated robot.

    python -m benchmarks.whole_error [runs] [table ...]     or  python -m benchmarks whole_error

Tables: perfect, cases, others, combined, sticking, inertias, speed; without a name all of them. The
robots are those of ``independent_robot``; plants, noise (0.1 to 3 % of the torque) and errors of the
given inertias change from run to run. A run is silently wrong if the error of K or D exceeds four stated
standard errors and no finding is a warning or a problem.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.stats import binomtest
from threadpoolctl import threadpool_limits

from benchmarks.bound import bound
from benchmarks.harness import Cell, Table, rms, written
from benchmarks.independent_robot import Array, paper_motions, simulate
from benchmarks.real_robots import (
    COMBINED,
    MANUTEC,
    OTHERS,
    PAPER,
    PERFECT,
    STICKING,
    THIRTEEN,
    Campaign,
    Case,
    band,
    random_robot,
    rubbing,
    wrong_inertia,
)
from jointid import (
    Analysis,
    Inertia,
    JointIdError,
    SineRecord,
    Study,
    analyse,
    extract_phasors,
    identify_elasticity,
)

INERTIA_STD = 0.05
"""Of a study that states none."""
SILENT = 4.0
"""Standard errors."""
NORMAL_95 = 1.95996
ALARM = ("warning", "problem")
HARDLY_KNOWN, MISSED = "poorly determined", "The frequencies miss"
"""Parts of the titles of findings that name missing records."""
WELL_KNOWN = 0.01
"""Relative Cramér–Rao bound up to which "poorly determined" is a false alarm."""
AT_ONCE = 16
"""Studies that are simulated together, to bound the memory."""

Row = dict[str, Cell]


@dataclass(frozen=True, eq=False)
class Outcome:
    """Result of an analysis, compared with the true values."""

    z: Array
    """Errors of K and D in stated standard errors, shape (2n,); 0 where nothing is stated."""
    error: Array
    """Relative errors of K and D."""
    standard_error: Array
    """As stated, relative to the truth."""
    alarms: tuple[str, ...]
    """Titles of warnings and problems; a refusal is one."""
    cpu_s: float
    analysis: Analysis | None

    @property
    def silent_wrong(self) -> bool:
        return not self.alarms and bool(np.any(~(np.abs(self.z) <= SILENT)))

    def false_alarm(self, least: Array) -> bool:
        """Whether there is an alarm, for perfect data with the relative bound ``least``."""
        excused = (MISSED,) if least.max() < WELL_KNOWN else (MISSED, HARDLY_KNOWN)
        return any(not any(part in title for part in excused) for title in self.alarms)

    @property
    def model(self) -> str:
        """The model that was chosen."""
        if self.analysis is None:
            return "refused"
        return next((c.name for c in self.analysis.fit.candidates if c.chosen), "")


def outcome(study: Study, answer: Array) -> Outcome:
    """Analyse a study and compare with the true K and D."""
    begin = time.process_time()
    try:
        analysis = analyse(study)
    except JointIdError as error:
        nothing = np.full(answer.size, np.nan)
        cpu_s = time.process_time() - begin
        title = f"refused: {error!s:.60}"
        return Outcome(np.zeros(answer.size), nothing, nothing, (title,), cpu_s, None)
    cpu_s = time.process_time() - begin
    fit = analysis.fit
    error = np.concatenate([fit.K, fit.D]) - answer
    alarms = tuple(finding.title for finding in analysis.findings if finding.level in ALARM)
    return Outcome(
        error / fit.standard_error, error / answer, fit.standard_error / answer, alarms, cpu_s, analysis
    )


def outcomes(campaigns: Sequence[Campaign], **study: float) -> list[Outcome]:
    """Simulate and analyse every campaign."""
    found = []
    for first in range(0, len(campaigns), AT_ONCE):
        part = campaigns[first : first + AT_ONCE]
        logs = simulate([(each.robot, each.experiment) for each in part])
        for each, records in zip(part, logs, strict=True):
            found.append(outcome(each.study(records, **study), each.answer))
    return found


def held(found: Sequence[Outcome]) -> Array:
    """Whether the 95 % intervals contain the true values, shape (runs, 2n)."""
    return np.array([np.abs(each.z) <= NORMAL_95 for each in found])


def frequent(words: Iterator[str], most: int = 3) -> str:
    """The most frequent words, with counts."""
    return "; ".join(f"{count} × {word}" for word, count in Counter(words).most_common(most))


def alarms(found: Sequence[Outcome]) -> str:
    return frequent(title for each in found for title in dict.fromkeys(each.alarms))


CASES = {
    "study": "", "runs": ".0f", "silently wrong": ".0f", "with a warning": ".0f", "false warning": ".0f",
    "truth within 95 %, %": ".0f", "largest error of a run, median, σ": ".1f",
    "largest silent error, σ": ".1f", "error of K, median, %": ".3f", "error of D, median, %": ".3f",
    "CPU, median, s": ".2f", "CPU, largest, s": ".2f", "models": "", "warnings": "",
}  # fmt: skip


def case_row(name: str, case: Case, runs: int, *, perfect: bool = False) -> Row:
    """Outcomes of a kind of study; an alarm is false where the studies are perfect."""
    campaigns = [case.campaign(run) for run in range(runs)]
    found = outcomes(campaigns)
    false = [each.false_alarm(least(c)) for each, c in zip(found, campaigns, strict=True)]
    calm = [float(np.abs(each.z).max()) for each in found if not each.alarms]
    cpu = [each.cpu_s for each in found]
    error = np.abs([each.error for each in found]).reshape(runs, 2, -1).max(axis=2)
    return {
        "study": f"{name}. {case.title}" if case.title else name,
        "runs": runs,
        "silently wrong": sum(each.silent_wrong for each in found),
        "with a warning": runs - len(calm),
        "false warning": sum(false) if perfect else None,
        "truth within 95 %, %": 100 * float(held(found).mean()),
        "largest error of a run, median, σ": float(np.median([np.abs(each.z).max() for each in found])),
        "largest silent error, σ": max(calm, default=None),
        "error of K, median, %": 100 * float(np.nanmedian(error[:, 0])),
        "error of D, median, %": 100 * float(np.nanmedian(error[:, 1])),
        "CPU, median, s": float(np.median(cpu)),
        "CPU, largest, s": max(cpu),
        "models": frequent((each.model for each in found), 2),
        "warnings": alarms(found),
    }


def least(campaign: Campaign, std: float = INERTIA_STD) -> Array:
    """Relative Cramér–Rao bound of K and D, shape (2n,), for inertias with a prior and no friction."""
    robot = campaign.robot
    return bound(robot, campaign.experiment, campaign.M, campaign.M2, std) / robot.answer


def case_rows(cases: Mapping[str, Case], *, perfect: bool = False) -> Callable[[int], Iterator[Row]]:
    def rows(runs: int) -> Iterator[Row]:
        for name, case in cases.items():
            yield case_row(name, case, runs, perfect=perfect)

    return rows


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
    "robot": "", "inertias": "", "runs": ".0f", "error of K, rms, %": ".3f", "error of D, rms, %": ".3f",
    "σ / bound, median": ".2f", "worst parameter": ".2f", "rms error / bound": ".2f",
    "truth within 95 %, %": ".1f", "least p × cells": ".3f", "with a warning": ".0f",
    "CPU, median, s": ".2f", "CPU, largest, s": ".2f", "warnings": "",
}  # fmt: skip


def inertia_campaigns(robot: str, inertias: str, runs: int) -> tuple[list[Campaign], Array]:
    """Campaigns with wrong inertias, and the relative bound of K and D, shape (runs, 2n)."""
    error, std, uniform = INERTIAS[inertias]
    campaigns, bounds = [], []
    for run in range(runs):
        rng = np.random.default_rng([run, 5])
        plant = ROBOTS[robot] or random_robot(rng)
        experiment = paper_motions(plant, band(plant), seed=run, noise=0.01)
        M, M2 = wrong_inertia(plant, rng, error, uniform=uniform)
        campaigns.append(Campaign(plant, experiment, M, M2))
        bounds.append(least(campaigns[-1], std))
    return campaigns, np.array(bounds)


def inertia_row(robot: str, inertias: str, runs: int) -> tuple[Row, Array]:
    """A row of the table, and whether each interval held, shape (runs, 2n)."""
    campaigns, bounds = inertia_campaigns(robot, inertias, runs)
    found = outcomes(campaigns, inertia_std=INERTIAS[inertias][1])
    holds = held(found)
    off = np.array([each.error for each in found])
    stated = np.nanmedian(np.array([each.standard_error for each in found]) / bounds, axis=0)
    cells = len(INERTIAS) * len(ROBOTS) * holds.shape[1]
    p = min(binomtest(int(column.sum()), runs, 0.95).pvalue for column in holds.T)
    n = holds.shape[1] // 2
    cpu = [each.cpu_s for each in found]
    row: Row = {
        "robot": robot,
        "inertias": inertias,
        "runs": runs,
        "error of K, rms, %": 100 * rms(off[:, :n]),
        "error of D, rms, %": 100 * rms(off[:, n:]),
        "σ / bound, median": float(np.median(stated)),
        "worst parameter": float(stated.max()),
        "rms error / bound": rms(off / bounds),
        "truth within 95 %, %": 100 * float(holds.mean()),
        "least p × cells": min(1.0, p * cells),
        "with a warning": sum(bool(each.alarms) for each in found),
        "CPU, median, s": float(np.median(cpu)),
        "CPU, largest, s": max(cpu),
        "warnings": alarms(found),
    }
    return row, holds


def inertia_rows(runs: int) -> Iterator[Row]:
    pooled = []
    for robot in ROBOTS:
        for inertias in INERTIAS:
            row, holds = inertia_row(robot, inertias, runs)
            pooled.append(holds)
            yield row
    yield {
        "robot": "all",
        "runs": runs,
        "truth within 95 %, %": 100 * float(np.concatenate(pooled).mean()),
    }


SPEED_COLUMNS = {
    "study": "", "records": ".0f", "samples": ",.0f", "paper's least squares, ms": ".1f",
    "analyse, ms": ".0f", "ratio": ".1f", "target": "", "warnings": "",
}  # fmt: skip


FAULTS: dict[str, Callable[[SineRecord], SineRecord]] = {
    "torque 2 reversed": lambda r: replace(r, tau_Nm=r.tau_Nm * [1, -1]),
    "torques swapped": lambda r: replace(r, tau_Nm=r.tau_Nm[:, ::-1]),
    "torques without sign": lambda r: replace(r, tau_Nm=np.abs(r.tau_Nm)),
    "torques clipped": lambda r: replace(
        r, tau_Nm=np.clip(r.tau_Nm, *(0.35 * np.ptp(r.tau_Nm, 0) * SIGNS))
    ),
    "positions in degrees": lambda r: replace(r, theta_rad=np.degrees(r.theta_rad)),
    "velocities as positions": lambda r: replace(
        r, theta_rad=np.gradient(r.theta_rad, r.time_s, axis=0)
    ),
}
SIGNS = np.array([[-1.0], [1.0]])


def speed_studies() -> Iterator[tuple[str, str, Study]]:
    """Name, aim and study."""
    fast = {"sample_rate_hz": 4000.0, "periods": 12.5}
    right = Case(motions=fast)
    made = right.campaign(0, noise=0.01)
    (records,) = simulate([(made.robot, made.experiment)])
    inertia = Inertia(made.M, made.M2)
    yield "good data", "3 s", Study(records, inertia)
    yield "M2 30 % too large", "3 s", Study(records, Inertia(made.M, 1.3 * made.M2))
    made = Case(motions=fast, change=rubbing(0.1, viscous=0.04)).campaign(0, noise=0.01)
    (records,) = simulate([(made.robot, made.experiment)])
    for name, fault in FAULTS.items():
        wrong = [fault(record) for record in records]
        yield f"friction, {name}", "3 s", Study(wrong, inertia, inertia_std=0.05)
    harder = replace(THIRTEEN["6"], motions=fast)
    sticking = replace(STICKING["Coulomb"], motions=fast)
    six = {"joints": 6, "band": (0.3, 3.0, 14)}
    for name, aim, case, run in (
        ("hardening of 50 %", "3 s", harder, 0),
        ("sticking, two joints", "12 ×", sticking, 0),
        ("six joints", "", Case(**six), 0),
        ("six joints, friction", "10 s", Case(change=rubbing(0.3, viscous=0.04), **six), 0),
        ("six joints, sticking", "10 s", Case(change=rubbing(0.8), **six), 0),
    ):
        made = case.campaign(run, noise=0.01)
        (records,) = simulate([(made.robot, made.experiment)])
        yield name, aim, made.study(records[:84])


def speed_rows(rounds: int) -> Iterator[Row]:
    for name, aim, study in speed_studies():
        spent, said = [], ""
        for _ in range(rounds):
            with threadpool_limits(1):
                paper_s, _ = cpu_s(lambda study=study: paper_fit(study))
                whole_s, result = cpu_s(lambda study=study: outcome(study, np.ones(2 * study.inertia.n)))
            spent.append((paper_s, whole_s, whole_s / paper_s))
            said = alarms([result])
        paper_s, whole_s, ratio = np.median(spent, axis=0)
        yield {
            "study": name,
            "records": len(study.records),
            "samples": sum(record.time_s.size for record in study.records),
            "paper's least squares, ms": 1e3 * paper_s,
            "analyse, ms": 1e3 * whole_s,
            "ratio": ratio,
            "target": aim,
            "warnings": said,
        }


def cpu_s(call: Callable[[], Any]) -> tuple[float, Any]:
    begin = time.process_time()
    result = call()
    return time.process_time() - begin, result


def paper_fit(study: Study) -> object:
    """The paper's least squares end to end, where it has a solution."""
    phasors = extract_phasors(study.records, harmonics=1)
    try:
        return identify_elasticity(phasors, study.inertias, method="least-squares")
    except JointIdError:
        return None


TABLES: dict[str, tuple[str, Mapping[str, str], Callable[[int], Iterator[Row]]]] = {
    "perfect": ("Studies that fit the model", CASES, case_rows(PERFECT, perfect=True)),
    "cases": ("Robots that deviate from the ideal model: thirteen cases", CASES, case_rows(THIRTEEN)),
    "others": ("Further deviations", CASES, case_rows(OTHERS)),
    "combined": ("Several deviations at once", CASES, case_rows(COMBINED)),
    "sticking": ("Sticking friction", CASES, case_rows(STICKING)),
    "inertias": ("Wrong inertias, torque noise of 1 %", INERTIA_COLUMNS, inertia_rows),
    "speed": ("CPU time from records to findings", SPEED_COLUMNS, speed_rows),
}
ROUNDS = 3
"""Of the table of times."""


def measure(quick: bool) -> Iterator[Table]:
    """Return the tables for ``python -m benchmarks whole_error``."""
    for name, (title, columns, rows) in TABLES.items():
        runs = 1 if quick else (ROUNDS if name == "speed" else 50)
        yield Table(f"whole_error, {name}", title, columns, tuple(rows(runs)))


def main(arguments: Sequence[str]) -> None:
    """Print tables row by row, each as soon as it is measured."""
    runs = int(arguments[0]) if arguments else 50
    for name in arguments[1:] or TABLES:
        title, columns, rows = TABLES[name]
        print(f"\n{Table(name, title, columns, ()).markdown()}", flush=True)
        for row in rows(min(runs, ROUNDS) if name == "speed" else runs):
            cells = (written(row.get(column), form) for column, form in columns.items())
            print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
