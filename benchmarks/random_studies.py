"""Random studies, good and absurd: no exception except a refusal, reproducible answers, CPU time.

    python -m benchmarks.random_studies [count] [first seed]    or  python -m benchmarks random_studies

The studies are those of ``tests/study_generator.py``: 1 to 6 joints at any scale, single records,
collinear, constant, clipped, tiny and huge signals. The inertias are exact, known to 5 or 30 %, or
unknown. A seed with a fault is printed with its exception.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.harness import Table
from jointid import Analysis, JointIdError, Study, analyse

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from study_generator import random_study

LARGE = 4
"""One in this many studies is large; the others have at most 3 joints and 4 records."""
COLUMNS = {"joints": "", "studies": ".0f", "answered": ".0f", "refused": ".0f", "faults": ".0f",
           "CPU s, median": ".3f", "99 %": ".2f", "most": ".2f", "seed of the slowest": ""}  # fmt: skip


@dataclass(frozen=True)
class Trial:
    """Outcome of the study of a seed."""

    seed: int
    joints: str
    answered: bool
    fault: str
    """An exception that is no refusal, or the difference of the second answer; empty otherwise."""
    cpu_s: float
    """Of the first analysis."""


def study_of(seed: int) -> Study:
    """Study of a seed, with inertias and torque scales known to any degree.

    Raises
    ------
    JointIdError
        When the study itself is refused.
    """
    rng = np.random.default_rng([seed, 3])
    study = random_study(seed, small=seed % LARGE != 0)
    inertia_std = float(rng.choice([0.0, 0.05, 0.05, 0.3, np.inf]))
    torque_std = rng.choice([None, None, 0.0, 0.02, np.inf])  # type: ignore[arg-type]
    return replace(study, inertia_std=inertia_std, torque_std=torque_std)


def trial(seed: int) -> Trial:
    """Make and analyse the study of a seed twice."""
    try:
        study = study_of(seed)
    except JointIdError:
        return Trial(seed, "refused", answered=False, fault="", cpu_s=0.0)
    joints = str(study.inertia.n)
    first: Analysis | None
    begin = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            first = analyse(study)
    except JointIdError as error:
        first, refusal = None, str(error)
    except Exception as error:  # any exception is a fault to report
        return Trial(seed, joints, False, f"{error!r:.300}", time.process_time() - begin)
    cpu_s = time.process_time() - begin
    try:
        second = analyse(study)
    except JointIdError as error:
        fault = "" if first is None and str(error) == refusal else "refused at one time only"
        return Trial(seed, joints, False, fault, cpu_s)
    fault = "refused at one time only" if first is None else difference(first, second)
    return Trial(seed, joints, first is not None, fault, cpu_s)


def difference(first: Analysis, second: Analysis) -> str:
    """What differs between two analyses of the same study, or is not a number in the first."""
    for name in ("K", "D", "standard_error", "covariance", "residual"):
        one, other = getattr(first.fit, name), getattr(second.fit, name)
        if not np.array_equal(one, other, equal_nan=True):
            return f"{name} differs the second time"
        if name in ("K", "D", "standard_error") and np.isnan(one).any():
            return f"{name} is not a number"
    return "" if first.findings == second.findings else "the findings differ the second time"


def row(joints: str, trials: list[Trial]) -> dict[str, str | float | None]:
    cpu = np.array([each.cpu_s for each in trials])
    faults = sum(bool(each.fault) for each in trials)
    answered = sum(each.answered for each in trials)
    return {
        "joints": joints,
        "studies": len(trials),
        "answered": answered,
        "refused": sum(not each.answered and not each.fault for each in trials),
        "faults": faults,
        "CPU s, median": float(np.median(cpu)),
        "99 %": float(np.percentile(cpu, 99)),
        "most": float(cpu.max()),
        "seed of the slowest": str(trials[int(np.argmax(cpu))].seed),
    }


def tables(trials: list[Trial]) -> Iterator[Table]:
    groups = sorted({each.joints for each in trials})
    rows = [row(name, [each for each in trials if each.joints == name]) for name in groups]
    yield Table("random_studies", "Random studies", COLUMNS, (*rows, row("all", trials)))
    kinds = Counter(each.fault.split("(")[0] for each in trials if each.fault)
    if kinds:
        found = tuple({"fault": kind, "studies": float(count)} for kind, count in kinds.most_common())
        yield Table("random_studies", "Faults", {"fault": "", "studies": ".0f"}, found)


def measure(quick: bool) -> Iterator[Table]:
    """Return the tables for ``python -m benchmarks random_studies``."""
    yield from tables([trial(seed) for seed in range(10 if quick else 10_000)])


def main(arguments: list[str]) -> int:
    """Print faults as they are found, then the tables; 1 when there is a fault."""
    count = int(arguments[0]) if arguments else 10_000
    first = int(arguments[1]) if len(arguments) > 1 else 0
    trials = []
    for seed in range(first, first + count):
        trials.append(trial(seed))
        if trials[-1].fault:
            print(f"seed {seed}: {trials[-1].fault}", flush=True)
    for table in tables(trials):
        print(table.markdown(), flush=True)
    return int(any(each.fault for each in trials))


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
