"""SIGKILL during writes of server, batch and convert: no data may be lost, half written or left over.

    python -m benchmarks.kills [count of each] [server] [batch] [convert]

Each process is killed at a random time, every second one as soon as it writes a file. All data that it
had acknowledged must exist, bit for bit; the next run continues and leaves no ``.new`` or ``.old``.
"""

from __future__ import annotations

import os
import random
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from threading import Thread

import numpy as np

from benchmarks.harness import Table
from jointid import load_study
from jointid.cli import app
from jointid.files.atomic_write import write_file
from jointid.files.digest import study_digest
from jointid.files.store import Store, new_workspace
from jointid.files.study_files import pack_study
from jointid.fleet.run import journal_path
from jointid.fleet.table import read_fleet

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))
COLUMNS = {
    "victim": "",
    **dict.fromkeys(("kills", "during a write", "acknowledged"), ".0f"),
    **dict.fromkeys(("lost", "half written", "left over"), ".0f"),
}
PARTS = ("server", "batch", "convert")
for module in ("importing.study", "importing.read.logs", "importing.find.segments", "fleet.run"):
    import_module(f"jointid.{module}")


def writing(folder: Path) -> list[Path]:
    """Files in a folder that are being written, or were left over."""
    return [*folder.rglob(".*.new"), *folder.rglob(".*.old")]


def killed(process: Fork, folder: Path, until_s: float, at_write: bool) -> bool:
    """Kill a process at a random time or at a write; True when it was writing. False if it had ended."""
    begin = time.monotonic()
    some, end = begin + random.uniform(0.1, 1.1) * until_s, begin + 3 * until_s
    while time.monotonic() < (end if at_write else some) and process.poll() is None:
        if at_write and time.monotonic() > some and writing(folder):
            break
        time.sleep(0.0005)
    process.kill()
    process.wait()
    return bool(writing(folder))


def swept(folder: Path, write: Callable[[], object]) -> int:
    """Number of left-over files after the next write."""
    for left in writing(folder):
        os.utime(left, (time.time() - 60,) * 2)  # a write takes left-overs of some age
    write()
    return len(writing(folder))


class Fork:
    """A function in a fork, which has loaded all modules: each start anew would take seconds."""

    def __init__(self, run: Callable[[], object]) -> None:
        self.returncode: int | None = None
        self._pid = os.fork()
        if self._pid == 0:
            with open(os.devnull, "w") as silent:
                os.dup2(silent.fileno(), 1)
                os.dup2(silent.fileno(), 2)
            try:
                run()
            except SystemExit as end:
                os._exit(int(end.code or 0))
            finally:
                os._exit(1)

    def poll(self) -> int | None:
        """The exit code; None while it runs."""
        if self.returncode is None:
            pid, status = os.waitpid(self._pid, os.WNOHANG)
            self.returncode = os.waitstatus_to_exitcode(status) if pid else None
        return self.returncode

    def kill(self) -> None:
        """End it at once."""
        if self.poll() is None:
            os.kill(self._pid, signal.SIGKILL)

    def wait(self) -> int:
        """The exit code, at its end."""
        while self.poll() is None:
            time.sleep(0.001)
        assert self.returncode is not None
        return self.returncode


def command(*arguments: object) -> Fork:
    """Begin a command line."""
    return Fork(lambda: app([*map(str, arguments)]))


def finish(*arguments: object) -> None:
    """Run the command line to its end; it must succeed."""
    code = command(*arguments).wait()
    if code:
        raise RuntimeError(f"jointid {arguments[0]} ended with code {code}")


def batch(count: int, folder: Path) -> Counter[str]:
    """Kill batches, each of which resumes the one before; a complete one must have every row."""
    from fleet_studies import write_studies

    paths = write_studies(folder, 12)
    out, found = folder / "rows.parquet", Counter[str]()
    acknowledged, begin = 0, time.monotonic()
    finish("batch", *paths, "--out", out, "--workers", 1)
    lasting = time.monotonic() - begin
    truth = {row.study: (row.K, row.D) for row in read_fleet(out)}
    out.unlink()
    while found["kills"] < count:
        process = command("batch", *paths, "--out", out, "--workers", 1)
        found["during a write"] += killed(process, folder, lasting, found["kills"] % 2 == 1)
        found["kills"] += process.returncode != 0
        journal = journal_path(out)
        lines = journal.read_bytes().count(b"\n") if journal.exists() else 0
        if out.exists():
            rows = {row.study: (row.K, row.D) for row in read_fleet(out)}
            found["half written"] += rows != truth
            out.unlink()
            journal.unlink(missing_ok=True)
            lines = 0
        else:
            found["lost"] += lines < acknowledged
            found["acknowledged"] += max(0, lines - max(acknowledged, 1))
        acknowledged = lines
    finish("batch", *paths, "--out", out, "--workers", 1)
    found["lost"] += len(read_fleet(out)) != len(paths)
    found["left over"] += swept(folder, lambda: write_file(folder / "x", b"")) + journal.exists()
    return found


def convert(count: int, folder: Path) -> Counter[str]:
    """Kill conversions into a zip and a folder that replace an earlier study."""
    log = write_log(folder)
    finish("convert", log, "--guess", folder / "map.json")
    found = Counter[str]()
    for half, target in enumerate((folder / "study.zip", folder / "study"), 1):
        given = ["convert", log, "--mapping", folder / "map.json", "--inertia", folder / "robot.toml"]
        given += ["-o", target, "--overwrite"]
        begin = time.monotonic()
        finish(*given)
        lasting = time.monotonic() - begin
        truth = study_digest(load_study(target))
        while found["kills"] < half * count / 2:
            process = command(*given)
            found["during a write"] += killed(process, folder, lasting, found["kills"] % 2 == 1)
            found["kills"] += process.returncode != 0
            found["acknowledged"] += process.returncode == 0
            if not target.exists():  # moved away a moment ago; the next run puts it back
                found["left over"] += swept(folder, lambda given=given: finish(*given))
            found["lost"] += not target.exists()
            found["half written"] += target.exists() and study_digest(load_study(target)) != truth
        found["left over"] += swept(folder, lambda given=given: finish(*given))
    return found


def write_log(folder: Path) -> Path:
    """Write four sines of a small robot as a log with rests, and its inertias."""
    from fleet_studies import small_study

    study, start = small_study(0), 0.0
    lines = ["time [s];motor position joint 1 [rad];motor torque 1 [Nm]"]
    for record in study.records:
        rest = np.zeros((record.time_s.size // 2, 2))
        motion = np.hstack([record.theta_rad[:, :1], record.tau_Nm[:, :1]])
        for row in (*np.tile(motion, (8, 1)), *rest):
            lines.append(f"{start:.4f};{row[0]:.12f};{row[1]:.9f}")
            start += record.interval_s
    (folder / "log.csv").write_text("\n".join(lines))
    inertia = study.inertia
    (folder / "robot.toml").write_text(
        f"[inertia]\nM = {inertia.M.tolist()}\nM2 = {inertia.M2.tolist()}\n"
    )
    return folder / "log.csv"


def server(count: int, folder: Path) -> Counter[str]:
    """Kill servers while a user opens one study after the other."""
    import browsing
    from fleet_studies import small_study
    from sessions import Session

    from jointid.ui.server import serving

    for module in serving.PRELOADED:
        import_module(module)
    serving.prepare = lambda: None  # the first screen costs more than all writes of a user

    class Server(browsing.Server):
        """The app in a fork."""

        def begin(self) -> Fork:
            os.environ["JOINTID_DATA_DIR"] = str(self.data)
            return Fork(lambda: serving.serve(str(self.folder / "app.py"), self.port))

    store, place, found = Store(folder), new_workspace(), Counter[str]()
    kept: dict[str, str] = {}
    victim = Server(ROOT, folder)

    def visit(first: int) -> None:
        """Open studies until the server dies; a study shown on the page counts as acknowledged."""
        with suppress(Exception):
            session = Session(victim.address)
            session.run("Glossary", f"w={place}")  # quick, with the sidebar of all pages
            for k in range(first, first + 1000):
                study = small_study(k)
                session.upload("A study folder", f"{k}.zip", pack_study(study))
                session.run("Glossary")
                acknowledged = {e.id: e.digest for e in store.entries(place) if e.name == f"{k}.zip"}
                kept.update(acknowledged)

    first = small_study(0)
    entry = store.put(place, "0.zip", study_digest(first), pack_study(first))
    kept[entry.id] = entry.digest
    lasting = 0.0
    while found["kills"] < count:
        visitor, begin = Thread(target=visit, args=(1 + 1000 * found["kills"],)), time.monotonic()
        visitor.start()
        while not lasting and len(store.entries(place)) < 3:
            time.sleep(0.01)
        lasting = lasting or time.monotonic() - begin
        found["during a write"] += killed(victim.process, folder, lasting, found["kills"] % 2 == 1)
        found["kills"] += 1
        visitor.join()
        there = {e.id: e.digest for e in store.entries(place)}
        found["lost"] += len(kept.keys() - there.keys()) + len(store.notes(place))
        found["acknowledged"] = max(found["acknowledged"], len(kept))
        for entry_id, digest in there.items():
            found["half written"] += study_digest(load_study(store.read(place, entry_id))) != digest
        victim.start()
    victim.kill()
    found["left over"] += swept(folder, lambda: store.put(place, "0.zip", "x", b"last"))
    return found


def measure(quick: bool) -> Iterator[Table]:
    """Kill each victim 200 times."""
    yield table(2 if quick else 200, PARTS)


def table(count: int, parts: Sequence[str]) -> Table:
    """Kill each of the victims this many times."""
    victims = {"server": server, "batch": batch, "convert": convert}
    rows = []
    for part in parts:
        with tempfile.TemporaryDirectory() as folder:
            found = victims[part](count, Path(folder))
        rows.append({"victim": part} | {column: found[column] for column in list(COLUMNS)[1:]})
    return Table("kills", "Killed while writing", COLUMNS, tuple(rows))


if __name__ == "__main__":
    named = [a for a in sys.argv[1:] if not a.isdigit()]
    counts = [int(a) for a in sys.argv[1:] if a.isdigit()]
    print(table(counts[0] if counts else 200, named or PARTS).markdown())
