"""Random experiments as set points: no written file exceeds a limit of its robot.

    python -m benchmarks.setpoints [count] [first seed]    or  python -m benchmarks setpoints

Robots, plans, limits and formats are those of ``tests/setpoint_readers.py``. A refused experiment is
written at the scale that the refusal names. Every file is read back, and its finite differences are
compared with the limits. A seed with a fault is printed.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.harness import Table

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from setpoint_readers import Outcome, outcome, random_trial

COLUMNS = {"format": "", "experiments": ".0f", "refused at first": ".0f", "faults": ".0f",
           "largest share of a limit": ".6f", "CPU s, median": ".3f"}  # fmt: skip
Trials = list[tuple[str, Outcome, float]]


def trial(seed: int) -> tuple[str, Outcome, float]:
    """Format, outcome and CPU time of a seed."""
    begin, made = time.process_time(), random_trial(seed)
    try:
        found = outcome(made)
    except Exception as error:  # any exception is a fault to report
        found = Outcome(False, f"{error!r:.300}", 0.0)
    if found.fault:
        print(f"seed {seed}: {found.fault}", flush=True)
    return made.file_format, found, time.process_time() - begin


def table(trials: Trials) -> Table:
    rows = []
    for name in (*sorted({each[0] for each in trials}), "all"):
        found = [each for each in trials if name in (each[0], "all")]
        rows.append(
            {
                "format": name,
                "experiments": len(found),
                "refused at first": sum(each.refused for _, each, _ in found),
                "faults": sum(bool(each.fault) for _, each, _ in found),
                "largest share of a limit": max(each.share for _, each, _ in found),
                "CPU s, median": float(np.median([cpu for *_, cpu in found])),
            }
        )
    return Table("setpoints", "Random experiments as set points", COLUMNS, tuple(rows))


def measure(quick: bool) -> Iterator[Table]:
    """Return the table for ``python -m benchmarks setpoints``."""
    yield table([trial(seed) for seed in range(20 if quick else 10_000)])


def main(arguments: list[str]) -> int:
    """Print faults as they are found, then the table; 1 when there is a fault."""
    count = int(arguments[0]) if arguments else 10_000
    first = int(arguments[1]) if len(arguments) > 1 else 0
    trials = [trial(seed) for seed in range(first, first + count)]
    print(table(trials).markdown(), flush=True)
    return int(any(each.fault for _, each, _ in trials))


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
