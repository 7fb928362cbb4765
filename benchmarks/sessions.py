"""Twenty people at one server: how long a rerun takes, and how much memory each of them costs.

The sessions speak the server's own protocol, because twenty browsers weigh more than the server that is
measured: the time of a rerun is from the act to the end of the script, without the browser's drawing.
"""

from __future__ import annotations

import os
import random
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness import Table
from jointid import Study, load_study
from jointid.files.digest import study_digest
from jointid.files.store import Store, new_workspace
from jointid.files.study_files import pack_study

ROOT = Path(__file__).parents[1]
PAGES = ("", "Records", "Phasors", "Transfer_matrix", "Elasticity", "Cut", "Plan", "Report")
COLUMNS = {"reruns": "", "count": ".0f", "median": "ms", "95th percentile": "ms", "longest": "ms"}
ARRIVING_S, THINKING_S = 30.0, (2.0, 6.0)
ZONE, ZONE_MM = "Corner zone (mm)", 10.0

OPENED, SEEN, NEW = "opening a study", "page and setting seen before", "page or setting the first time"


def measure(quick: bool) -> Iterator[Table]:
    """Two tables: every rerun, and the kinds of which it is made."""
    for shared in (True, False):
        yield _crowd(shared, quick)


def _crowd(shared: bool, quick: bool) -> Table:
    """Twenty people with one study, as in a course, or each with a study that nobody else has."""
    sys.path.insert(0, str(ROOT / "tests"))
    from browsing import Server

    people, arriving, lasting = (3, 0.5, 3.0) if quick else (20, ARRIVING_S, 90.0)
    thinking = (0.1, 0.3) if quick else THINKING_S
    sample = load_study(ROOT / "sample_data" / "paper.zip")
    with tempfile.TemporaryDirectory() as folder:
        server = Server(ROOT, Path(folder))
        try:
            store = Store(Path(folder))
            places = [_kept(sample, 0 if shared else k, store) for k in range(people)]
            _warmed(server.address)
            crowd = [Person(server.address, *places[k], random.Random(k)) for k in range(people)]
            if shared:  # what one of them has seen, the server has computed for all
                for person in crowd:
                    person.seen = crowd[0].seen
            begin = time.monotonic()
            until, before = begin + lasting, _Used.by(server.process.pid)
            with ThreadPoolExecutor(people) as threads:
                for person in crowd:
                    threads.submit(person.live, begin, arriving, until, thinking)
            passed = time.monotonic() - begin
            after = _Used.by(server.process.pid)
        finally:
            server.kill()
    problems = [person.problem for person in crowd if person.problem]
    if problems:
        raise RuntimeError(f"{len(problems)} of {people} people could not go on: {problems[0]}")
    took = [one for person in crowd for one in person.took]
    rows = [_row("every rerun", [s for _, s in took])]
    rows += [_row(kind, [s for k, s in took if k == kind]) for kind in (SEEN, NEW, OPENED)]
    whose = "one study" if shared else "a study each"
    return Table(
        f"sessions, {whose}",
        f"{people} people at once, {whose}",
        COLUMNS,
        tuple(row for row in rows if row),
        (
            f"They arrive within {arriving:g} s at a server that has shown a page before, with "
            f"{'the same study' if shared else 'studies'} of two joints, and act every "
            f"{thinking[0]:g} to {thinking[1]:g} s until {lasting:g} s: another page, or on it another "
            "record, estimator or corner zone of the cut. Opening is the first screen of a study that "
            "the server keeps. The first time is that of this study with this page, estimator and "
            "setting, and what the first screen adds by itself once it stands.",
            f"The server kept {(after.here_s - before.here_s) / passed:.2f} processors busy; its memory "
            f"grew by {(after.here_MB - before.here_MB) / people:.0f} MB per person. Its "
            f"{after.others} processes for computations kept "
            f"{after.others_s / passed:.2f} busy and took {after.others_MB:.0f} MB.",
        ),
    )


@dataclass
class Person:
    """Somebody with a study, who looks at one page after the other and changes settings."""

    address: str
    place: str
    study: str
    chance: random.Random
    took: list[tuple[str, float]] = field(default_factory=list)
    """Kind and seconds of every rerun."""
    problem: str = ""
    page: str = ""
    settings: dict[str, str] = field(default_factory=dict)
    zone_mm: float = ZONE_MM
    seen: set[tuple[str, ...]] = field(default_factory=set)

    def live(self, begin: float, arriving: float, until: float, thinking: tuple[float, float]) -> None:
        """Arrive, then act until the time is over."""
        from sessions import Session

        try:
            time.sleep(self.chance.uniform(0, arriving))
            self.session = Session(self.address)
            self.timed("", f"w={self.place}&study={self.study}", OPENED)
            while True:
                pause = self.chance.uniform(*thinking)
                if time.monotonic() + pause > until:
                    break
                time.sleep(pause)
                self.act()
            self.session.close()
        except Exception as error:  # a thread's error would otherwise be lost
            self.problem = f"{type(error).__name__}: {error}"

    def act(self) -> None:
        """Change a setting of this page if it has one, else and half of the time go to another page."""
        change = CHANGES.get(self.page)
        if change is not None and self.chance.random() < 0.5 and change(self):
            self.timed(self.page)
        else:
            self.timed(self.chance.choice([page for page in PAGES if page != self.page]))

    def timed(self, page: str, query: str = "", kind: str = "") -> None:
        """Run a page, and note how long it took and whether it was new."""
        self.page = page
        key = (page, self.settings.get("Estimator", ""), self.settings.get(page, ""))
        begin = time.perf_counter()
        elements = self.session.run(page, query)
        self.took.append((kind or (SEEN if key in self.seen else NEW), time.perf_counter() - begin))
        self.seen.add(key)
        if any(element.HasField("exception") for element in elements):
            raise RuntimeError(f"page {page or 'Study'} shows an exception")
        if self.session.asked and (took := self.session.settle()):
            self.took.append((NEW, took))


def _chosen(person: Person, label: str, kept_as: str) -> bool:
    box = person.session.shows("selectbox", label)
    if box is None:
        return False
    person.settings[kept_as] = person.chance.choice(list(box.options))
    person.session.choose(label, person.settings[kept_as])
    return True


def _zone(person: Person) -> bool:
    if person.session.shows("slider", ZONE) is None:
        return False  # these springs allow no cut
    person.zone_mm -= 0.5
    person.session.slide(ZONE, person.zone_mm)
    person.settings[person.page] = f"{person.zone_mm:g}"
    return True


CHANGES: dict[str, Callable[[Person], bool]] = {
    "Records": lambda person: _chosen(person, "Record", person.page),
    "Phasors": lambda person: _chosen(person, "Record", person.page),
    "Elasticity": lambda person: _chosen(person, "Estimator", "Estimator"),
    "Cut": _zone,
}
"""By page, what changes a setting there, if it can be changed."""


def _warmed(address: str) -> None:
    """Let the server import what it needs: nobody arrives at one that was started this second."""
    from sessions import Session

    session = Session(address)
    session.run("")
    session.close()


def _kept(sample: Study, number: int, store: Store) -> tuple[str, str]:
    """Keep a study that nobody else has; returns its workspace and its id."""
    study, place = replace(sample, name=f"Cell {number}"), new_workspace()
    entry = store.put(
        place,
        f"p{number}.zip",
        study_digest(study),
        pack_study(study, record_format="parquet"),  # as the app keeps them
    )
    return place, entry.id


def _row(name: str, seconds: list[float]) -> dict[str, Any]:
    if not seconds:
        return {}
    median, high = np.percentile(seconds, [50, 95])
    return {
        "reruns": name,
        "count": float(len(seconds)),
        "median": float(median),
        "95th percentile": float(high),
        "longest": max(seconds),
    }


@dataclass(frozen=True)
class _Used:
    """Processor time and resident memory of a server and of the processes that it began."""

    here_s: float
    here_MB: float
    others: int
    others_s: float
    others_MB: float

    @classmethod
    def by(cls, server: int) -> _Used:
        """Read them; not numbers where /proc does not tell."""
        others = _children(server)
        return cls(
            _cpu_s(server),
            _memory(server),
            len(others),
            sum(map(_cpu_s, others)),
            sum(map(_memory, others)),
        )


def _children(process: int) -> list[int]:
    try:
        tasks = Path(f"/proc/{process}/task").iterdir()
        return [int(child) for task in tasks for child in (task / "children").read_text().split()]
    except OSError:
        return []


def _memory(process: int) -> float:
    """Resident memory of a process, MB; not a number where /proc does not tell."""
    try:
        text = Path(f"/proc/{process}/status").read_text("utf-8")
    except OSError:
        return float("nan")
    return next(int(line.split()[1]) / 1024 for line in text.splitlines() if line.startswith("VmRSS"))


def _cpu_s(process: int) -> float:
    """Processor time that a process took so far, s; not a number where /proc does not tell."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text("utf-8").rpartition(")")[2].split()
    except OSError:
        return float("nan")
    return (int(fields[11]) + int(fields[12])) / float(os.sysconf("SC_CLK_TCK"))
