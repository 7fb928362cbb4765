"""Twenty people at one server: how long a rerun takes, and how much memory each of them costs.

The sessions speak the server's own protocol, because twenty browsers weigh more than the server that is
measured: the time of a rerun is from the act to the end of the script, without the browser's drawing.
Everybody has a study of two joints of their own and does something every two to six seconds.
"""

from __future__ import annotations

import random
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.harness import Table
from jointid import load_study
from jointid.digest import study_digest
from jointid.store import Store, new_workspace
from jointid.study_files import pack_study

ROOT = Path(__file__).parents[1]
PAGES = ("", "Records", "Phasors", "Transfer_matrix", "Elasticity", "Cut", "Plan", "Report")
COLUMNS = {"reruns": "", "count": ".0f", "median": "ms", "95th percentile": "ms"}


def measure(quick: bool) -> Iterator[Table]:
    """One table: all reruns, first visits of a page, and pages seen before."""
    sys.path.insert(0, str(ROOT / "tests"))
    from browsing import Server
    from sessions import Session

    people, acts = (3, 3) if quick else (20, 16)
    sample = load_study(ROOT / "sample_data" / "paper.zip")
    with tempfile.TemporaryDirectory() as folder:
        server = Server(ROOT, Path(folder))
        try:
            store = Store(Path(folder))

            def visit(person: int) -> list[tuple[bool, float]]:
                study, place = replace(sample, name=f"Cell {person}"), new_workspace()
                entry = store.put(place, f"p{person}.zip", study_digest(study), pack_study(study))
                chance, seen, took = random.Random(person), set(), []
                session = Session(server.address)
                session.run("", f"w={place}&study={entry.id}")
                for _ in range(acts):
                    time.sleep(0.1 if quick else chance.uniform(2, 6))
                    page = chance.choice(PAGES)
                    begin = time.perf_counter()
                    session.run(page)
                    took.append((page in seen, time.perf_counter() - begin))
                    seen.add(page)
                session.close()
                return took

            begin = _memory(server.process.pid)
            with ThreadPoolExecutor(people) as threads:
                took = [one for person in threads.map(visit, range(people)) for one in person]
            grown = (_memory(server.process.pid) - begin) / people
        finally:
            server.kill()
    rows = []
    for name, chosen in (
        ("all", took),
        ("page seen before", [t for t in took if t[0]]),
        ("page opened the first time", [t for t in took if not t[0]]),
    ):
        seconds = np.array([second for _, second in chosen])
        if seconds.size:
            low, high = np.percentile(seconds, [50, 95])
            row = {"reruns": name, "count": float(seconds.size), "median": low, "95th percentile": high}
            rows.append(row)
    note = f"Memory of the server grows by {grown:.0f} MB per person."
    yield Table("sessions", f"{people} people at once", COLUMNS, tuple(rows), (note,))


def _memory(process: int) -> float:
    """Resident memory of a process, MB."""
    for line in Path(f"/proc/{process}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    return float("nan")
