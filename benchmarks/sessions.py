"""Twenty users at one server: duration of reruns, memory and descriptors over time.

    python -m benchmarks.sessions [people, 20] [minutes, 10] [picture.svg]

The sessions speak the server's own protocol, because twenty browsers would load the machine more than
the server does. A rerun lasts from the user's input to the end of the script, without drawing in the
browser.
"""

from __future__ import annotations

import math
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
from jointid.reporting.drawing import Drawing, Line, Marks, Text, to_svg

BLUE = "#0072B2"
ROOT = Path(__file__).parents[1]
PAGES = ("", "Records", "Phasors", "Transfer_matrix", "Elasticity", "Cut", "Plan", "Report")
MINUTES = {"minute": "", "reruns": ".0f", "95th percentile": "ms", "longest": "ms",
           "memory, MB": ".0f", "descriptors": ".0f"}  # fmt: skip
COLUMNS = {"reruns": "", "count": ".0f", "median": "ms", "95th percentile": "ms", "longest": "ms",
           "in a queue": ".0f"}  # fmt: skip
LEAVING_S = 90.0
ZONE, ZONE_MM = "Corner zone (mm)", 10.0

OPENED, SEEN, NEW = "opening a study", "page and setting seen before", "page or setting the first time"


def measure(quick: bool) -> Iterator[Table]:
    """Reruns and the server over time, for one study and for studies of their own."""
    for shared in (True, False):
        crowd = Crowd(3, 3.0, 0.5, (0.1, 0.3), shared) if quick else Crowd(20, 90.0, shared=shared)
        yield from crowd.tables()


@dataclass
class Crowd:
    """Users with one study, as in a course, or each with a study of their own."""

    people: int
    lasting_s: float
    arriving_s: float = 30.0
    thinking_s: tuple[float, float] = (2.0, 6.0)
    shared: bool = False
    samples: list[Sample] = field(default_factory=list)
    took: list[Rerun] = field(default_factory=list)

    def run(self) -> str:
        """Run the users at a new server; observe it until a minute and a half after they left."""
        sys.path.insert(0, str(ROOT / "tests"))
        from browsing import Server

        sample = load_study(ROOT / "sample_data" / "paper.zip")
        with tempfile.TemporaryDirectory() as folder:
            server = Server(ROOT, Path(folder))
            try:
                store = Store(Path(folder))
                places = [_kept(sample, 0 if self.shared else k, store) for k in range(self.people)]
                _warmed(server.address)
                begin = time.monotonic()
                crowd = [
                    Person(server.address, *places[k], random.Random(k), begin)
                    for k in range(self.people)
                ]
                if self.shared:  # results shown to one user are cached for all
                    for person in crowd:
                        person.seen = crowd[0].seen
                before = _Used.by(server.process.pid)
                until = begin + self.lasting_s
                with ThreadPoolExecutor(self.people) as threads:
                    for person in crowd:
                        threads.submit(person.live, self.arriving_s, until, self.thinking_s)
                    while time.monotonic() < until:
                        self._watch(server.process.pid, begin)
                after, passed = _Used.by(server.process.pid), time.monotonic() - begin
                leaving = time.monotonic() + (LEAVING_S if self.lasting_s > LEAVING_S else 0.0)
                while time.monotonic() < leaving:
                    self._watch(server.process.pid, begin)
            finally:
                server.kill()
        problems = [person.problem for person in crowd if person.problem]
        if problems:
            raise RuntimeError(f"{len(problems)} of {self.people} could not go on: {problems[0]}")
        self.took = [one for person in crowd for one in person.took]
        busy_s = after.here_s - before.here_s
        return (
            f"A rerun took {1e3 * busy_s / len(self.took):.0f} ms of its processor time. "
            f"The server kept {busy_s / passed:.2f} processors busy, its "
            f"{after.others} processes for computations {after.others_s / passed:.2f} in "
            f"{after.others_MB:.0f} MB. Load of the machine at the end: {os.getloadavg()[0]:.1f}."
        )

    def _watch(self, server: int, begin: float) -> None:
        open_files = len(os.listdir(f"/proc/{server}/fd"))
        self.samples.append(Sample(time.monotonic() - begin, _memory(server), open_files))
        time.sleep(0.5)

    def tables(self) -> Iterator[Table]:
        """Run, and return reruns by kind and the server by minute."""
        note = self.run()
        rows = [_row("every rerun", self.took)]
        for kind in (SEEN, NEW, OPENED):
            rows.append(_row(kind, [r for r in self.took if r.kind == kind]))
        for page in PAGES:
            for kind, when in ((NEW, "first"), (SEEN, "again")):
                name = f"{page.replace('_', ' ') or 'Study'}, {when}"
                rows.append(_row(name, [r for r in self.took if (r.page, r.kind) == (page, kind)]))
        whose = "one study" if self.shared else "a study each"
        yield Table(
            f"sessions, {whose}",
            f"{self.people} people at once, {whose}",
            COLUMNS,
            tuple(row for row in rows if row),
            (
                f"They arrive within {self.arriving_s:g} s with "
                f"{'the same study' if self.shared else 'studies'} of two joints, and act every "
                f"{self.thinking_s[0]:g} to {self.thinking_s[1]:g} s until {self.lasting_s:g} s: "
                "another page, or another record, estimator or corner zone of the cut on the same page. "
                "Opening: the first screen of a study that the server keeps. The first time: of this "
                "study with this page, estimator and setting, including what the first screen adds by "
                "itself. In a queue: the page said that the server is busy.",
                note,
            ),
        )
        minutes: list[dict[str, Any]] = []
        for minute in range(math.ceil(self.samples[-1].time_s / 60)):
            inside = [s for s in self.samples if s.time_s // 60 == minute]
            reruns = [r.took_s for r in self.took if r.begin_s // 60 == minute]
            if inside:
                minutes.append(
                    {"minute": f"{minute + 1}", "reruns": float(len(reruns))}
                    | ({"95th percentile": _high(reruns), "longest": max(reruns)} if reruns else {})
                    | {"memory, MB": inside[-1].memory_MB, "descriptors": float(inside[-1].descriptors)}
                )
        title = f"The server, {whose}"
        yield Table(
            title.lower(), title, MINUTES, tuple(minutes), ("All have left before the last lines.",)
        )

    def picture(self) -> str:
        """SVG of reruns, memory and descriptors over time."""
        reruns = np.array([[r.begin_s, r.took_s] for r in self.took])
        watched = np.array([[s.time_s, s.memory_MB, s.descriptors] for s in self.samples])
        panels = [
            ("rerun, s", reruns, True),
            ("memory, MB", watched[:, :2], False),
            ("descriptors", watched[:, [0, 2]], False),
        ]
        shapes: list[Line | Marks | Text] = []
        for k, (label, points, scattered) in enumerate(panels):
            top, height, width = 24.0 + 120 * k, 84.0, 640.0
            high, end = float(points[:, 1].max()) * 1.05, float(watched[-1, 0])
            place = np.column_stack(
                [60 + points[:, 0] / end * width, top + height * (1 - points[:, 1] / high)]
            )
            frame = np.array([[60, top], [60, top + height], [60 + width, top + height]])
            shapes += [Line(frame, "#B8B8B8", 0.8), Text(60, top - 6, label, 10, bold=True)]
            shapes += [Text(54, top + 8, f"{high:.3g}", 9, "end"), Text(54, top + height, "0", 9, "end")]
            shapes.append(Text(60 + width, top + height + 14, f"{end / 60:.1f} min", 9, "end"))
            shapes.append(Marks(place, BLUE, size=2) if scattered else Line(place, BLUE, 1.2))
        about = f"Reruns, memory and descriptors of a server with {self.people} people."
        return on_white(to_svg(Drawing(720, 372, tuple(shapes), about)))


def on_white(svg: str) -> str:
    """A page may be dark; the ink is not."""
    head, rest = svg.split(">", 1)
    style = 'font-family="Roboto, Helvetica, Arial, sans-serif"'
    return f'{head} {style}><rect width="100%" height="100%" rx="6" fill="#FFFFFF"/>{rest}\n'


@dataclass(frozen=True)
class Sample:
    """The server at a time."""

    time_s: float
    memory_MB: float
    descriptors: int


@dataclass(frozen=True)
class Rerun:
    """One rerun that a user waited for."""

    kind: str
    page: str
    begin_s: float
    took_s: float
    queued: bool
    """Whether the page said that computations of others come first."""


@dataclass
class Person:
    """A user with a study, who opens one page after the other and changes settings."""

    address: str
    place: str
    study: str
    chance: random.Random
    begin: float
    took: list[Rerun] = field(default_factory=list)
    problem: str = ""
    page: str = ""
    settings: dict[str, str] = field(default_factory=dict)
    zone_mm: float = ZONE_MM
    seen: set[tuple[str, ...]] = field(default_factory=set)

    def live(self, arriving: float, until: float, thinking: tuple[float, float]) -> None:
        """Connect, then act until the time is over."""
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
        took = time.perf_counter() - begin
        queued = any("in the queue" in element.spinner.text for element in elements)
        self._note(kind or (SEEN if key in self.seen else NEW), took, queued)
        self.seen.add(key)
        if any(element.HasField("exception") for element in elements):
            raise RuntimeError(f"page {page or 'Study'} shows an exception")
        if self.session.asked and (took := self.session.settle()):
            self._note(NEW, took)

    def _note(self, kind: str, took_s: float, queued: bool = False) -> None:
        begin_s = time.monotonic() - self.begin - took_s
        self.took.append(Rerun(kind, self.page, begin_s, took_s, queued))


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
    """Let the server finish its imports, as in practice before users connect."""
    from sessions import Session

    session = Session(address)
    session.run("")
    session.close()


def _kept(sample: Study, number: int, store: Store) -> tuple[str, str]:
    """Store a unique study; return its workspace and its digest."""
    study, place = replace(sample, name=f"Cell {number}"), new_workspace()
    entry = store.put(
        place,
        f"p{number}.zip",
        study_digest(study),
        pack_study(study, record_format="parquet"),  # as the app keeps them
    )
    return place, entry.digest


def _row(name: str, reruns: list[Rerun]) -> dict[str, Any]:
    if not reruns:
        return {}
    seconds = [rerun.took_s for rerun in reruns]
    return {
        "reruns": name,
        "count": float(len(reruns)),
        "median": float(np.median(seconds)),
        "95th percentile": _high(seconds),
        "longest": max(seconds),
        "in a queue": float(sum(rerun.queued for rerun in reruns)),
    }


def _high(seconds: list[float]) -> float:
    return float(np.percentile(seconds, 95))


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
        """Read them; NaN where /proc has no value."""
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
    """Resident memory of a process, MB; NaN where /proc has no value."""
    try:
        text = Path(f"/proc/{process}/status").read_text("utf-8")
    except OSError:
        return float("nan")
    return next(int(line.split()[1]) / 1024 for line in text.splitlines() if line.startswith("VmRSS"))


def _cpu_s(process: int) -> float:
    """Processor time of a process so far, s; NaN where /proc has no value."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text("utf-8").rpartition(")")[2].split()
    except OSError:
        return float("nan")
    return (int(fields[11]) + int(fields[12])) / float(os.sysconf("SC_CLK_TCK"))


def main(arguments: list[str]) -> None:
    """Print both tables, and draw the picture."""
    numbers = [float(a) for a in arguments[:2]]
    people, minutes = [*numbers, *(20.0, 10.0)[len(numbers) :]]
    crowd = Crowd(int(people), 60 * minutes)
    for table in crowd.tables():
        print(table.markdown(), end="\n\n")
    if arguments[2:]:
        Path(arguments[2]).write_text(crowd.picture(), "utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
