"""Damaged logs over all readers: a table or a JointIdError, never another exception, in bounded time.

    python -m benchmarks.mutated_logs [count] [first seed]    or  python -m benchmarks mutated_logs

Every format has a file of its own, made by ``tests/format_makers.py`` and ``tests/log_makers.py``. A
mutation changes, cuts or doubles a few bytes, often near the beginning, where the structure is; its seed
repeats it. Binary formats are read by one process that must survive. A fault is printed with its seed.
"""

from __future__ import annotations

import random
import sys
import tempfile
import time
import warnings
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.harness import Cell, Table
from jointid import JointIdError
from jointid.importing import read_logs

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from log_mutations import KINDS, TEXTS, check, mutated

ALL = KINDS | TEXTS
COLUMNS = {"format": "", "mutations": ".0f", "read": ".0f", "refused": ".0f", "faults": ".0f",
           "child ended": ".0f", "slowest, s": ".2f", "seed of the slowest": ""}  # fmt: skip
_ENDED = ("crashes the reader", "took more than")


@dataclass(frozen=True)
class Outcome:
    """Outcome of one mutation."""

    seed: int
    said: str
    """"read", "refused", or "fault: …"."""
    ended: bool
    """Whether the reading process ended."""
    wall_s: float


def outcomes(kind: str, data: bytes, seeds: Sequence[int]) -> Iterator[Outcome]:
    """Mutate and read a file once for every seed."""

    def results(first: int) -> Iterator[object]:
        changed = (random.Random(s * 1_000_003 + zlib.crc32(kind.encode())) for s in seeds[first:])
        return read_logs((mutated(data, rng), kind) for rng in changed)

    found = results(0)
    for place, seed in enumerate(seeds):
        begin = time.monotonic()
        ended = False
        try:
            result = next(found)
        except Exception as error:
            said, found = f"fault: {type(error).__name__}: {error!s:.200}", results(place + 1)
        else:
            said = _checked(result)
            ended = isinstance(result, JointIdError) and any(part in str(result) for part in _ENDED)
        yield Outcome(seed, said, ended, time.monotonic() - begin)


def _checked(result: object) -> str:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return check(result)
    except Exception as error:
        return f"fault: {type(error).__name__}: {error!s:.200}"


def sample(count: int, first: int = 0) -> dict[str, list[Outcome]]:
    """Outcomes by format; every format has the same number of mutations."""
    each = max(1, count // len(ALL))
    found = {}
    for kind, make in ALL.items():
        with tempfile.TemporaryDirectory() as folder:
            data = make(Path(folder))
        found[kind] = list(outcomes(kind, data, range(first, first + each)))
    return found


def table(found: dict[str, list[Outcome]]) -> Table:
    """Counts by format, and their sum."""
    rows: list[dict[str, Cell]] = []
    for kind, each in (*found.items(), ("all", [o for part in found.values() for o in part])):
        counts = Counter(o.said.partition(":")[0] for o in each)
        slowest = max(each, key=lambda o: o.wall_s)
        rows.append(
            {
                "format": kind,
                "mutations": len(each),
                "read": counts["read"],
                "refused": counts["refused"],
                "faults": counts["fault"],
                "child ended": sum(o.ended for o in each),
                "slowest, s": slowest.wall_s,
                "seed of the slowest": str(slowest.seed),
            }
        )
    return Table("mutated_logs", "Mutated logs", COLUMNS, tuple(rows))


def measure(quick: bool) -> Iterator[Table]:
    """Return the table for ``python -m benchmarks mutated_logs``."""
    yield table(sample(10 * len(ALL) if quick else 100_000))


def main(arguments: list[str]) -> int:
    """Print the table and every fault; 1 when there is one."""
    count = int(arguments[0]) if arguments else 100_000
    found = sample(count, int(arguments[1]) if len(arguments) > 1 else 0)
    print(table(found).markdown())
    faults = [(kind, o) for kind, each in found.items() for o in each if o.said.startswith("fault")]
    for kind, outcome in faults:
        print(f"{kind}, seed {outcome.seed}: {outcome.said}")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
