"""A fleet of studies: the plain loop against jointid batch, on this computer and on a Dask cluster.

    python -m benchmarks.batch [--studies 1000] [--json FILE]

The studies are of robots that all differ (one to three joints, stiffness, damping, inertia), each with
steady sines and noise. Every way is timed from its call to the complete table, including the
start of its processes. The cluster is started beforehand and has two workers of one thread each. The
last run has five studies without an answer among the others (a broken zip, a NaN, a missing file, one
that never ends, one that crashes its process), and one of the two workers is killed midway; then every
row is compared with the plain loop's, bit by bit.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import signal
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness import Cell, Table
from jointid import (
    Elasticity,
    Inertia,
    SineRecord,
    Study,
    analyse,
    load_study,
    motor_response,
    save_study,
)
from jointid.fleet import Limits, Progress, Row, Summary, analyse_fleet, read_fleet
from jointid.fleet.row import row_of
from jointid.fleet.studies import content_digest

RATE_HZ = 1000.0
FREQUENCIES_HZ = (3.0, 6.0, 10.0, 15.0, 21.0, 28.0)
WORKERS = 2
COLUMNS = {
    "way": "",
    "time": ".1f",
    "studies per s": ".1f",
    "against the loop": ".2f",
    "ms per study beyond the loop": ".1f",
    "ms per study besides the work": ".1f",
    "first row after": ".1f",
    "rows that differ": ".0f",
}

# A process that opens one of these two files never returns. Only those that read studies open them.
HARM = """
import os, signal, sys, time
def look(event, arguments):
    if event == "open" and isinstance(arguments[0], (str, bytes)):
        name = os.path.basename(os.fsdecode(arguments[0]))
        if name == "endless.zip":
            time.sleep(1e6)
        if name == "deadly.zip":
            os.kill(os.getpid(), signal.SIGSEGV)
sys.addaudithook(look)
"""


@dataclass(frozen=True)
class Way:
    """One way through all studies."""

    name: str
    time_s: float
    wrong: int
    """Rows that are missing, duplicated or different from the plain loop's."""
    first_s: float | None = None
    """Time to the first row, s."""
    idle_s: float | None = None
    """Time of the workers, from the first row on, in which no study was read or analysed, s."""


def measure(quick: bool = False, *, studies: int | None = None) -> tuple[Table, ...]:
    """Time every way; ``quick`` takes 40 studies."""
    count = studies or (40 if quick else 1000)
    with tempfile.TemporaryDirectory(prefix="jointid-fleet-") as name:
        folder = Path(name).resolve()  # rows name studies by their real paths
        begin = time.perf_counter()
        paths = make_studies(folder, count)
        made = time.perf_counter() - begin
        truth, loop = plain_loop(paths)
        ways = [Way("plain loop, one process", loop, 0)]
        for workers in (1, WORKERS):
            out = folder / f"local{workers}.parquet"
            ways.append(timed(f"batch, {workers} workers", paths, out, truth, workers, workers=workers))
        notes = [
            f"{count} studies, made in {made:.0f} s; {1e3 * loop / count:.1f} ms each in the loop.",
            "Beyond the loop: the workers' time less the loop's, start of the processes included. "
            "Besides the work: the workers' time, from the first row on, in which nothing was read or "
            "analysed.",
        ]
        with cluster() as address:
            if address is None:
                notes.append("distributed is not installed: no cluster.")
            else:
                out = folder / "cluster.parquet"
                name = f"batch, Dask, {WORKERS} workers"
                ways.append(timed(name, paths, out, truth, WORKERS, scheduler=address))
                summary, wrong = harmed(folder, paths, truth, address)
                ways.append(Way("… one killed, 5 poisoned studies", summary.time_s, wrong))
                kinds = ", ".join(sorted(row.failure for row in summary.failures))
                notes.append(
                    f"With the killed worker and the poisoned studies: {summary.good} answers, "
                    f"{len(summary.failures)} errors ({kinds}); the study that never ends takes its 5 s."
                )
    return (Table("batch", "A fleet of studies", COLUMNS, tuple(_rows(ways, count)), tuple(notes)),)


def timed(
    name: str, paths: Sequence[Path], out: Path, truth: dict[str, Row], count: int, **how: Any
) -> Way:
    """One way through all studies, to an exact table."""
    first: list[Progress] = []

    def note(progress: Progress) -> None:
        if progress.done == 1:
            first.append(progress)

    summary = analyse_fleet(paths, out, progress=note, **how)
    begin = first[0].time_s
    work = sum(row.time_s for row in read_fleet(out)) - (first[0].last.time_s if first[0].last else 0.0)
    idle = (summary.time_s - begin) * count - work
    return Way(name, summary.time_s, wrong_rows(out, truth), begin, idle)


def _rows(ways: Sequence[Way], count: int) -> Iterator[dict[str, Cell]]:
    loop = ways[0].time_s
    for way in ways:
        workers = 1 if way is ways[0] or "1 workers" in way.name else WORKERS
        yield {
            "way": way.name.replace("1 workers", "1 worker"),
            "time": way.time_s,
            "studies per s": count / way.time_s,
            "against the loop": way.time_s / loop,
            "ms per study beyond the loop": 1e3 * (way.time_s * workers - loop) / count,
            "ms per study besides the work": way.idle_s and 1e3 * way.idle_s / count,
            "first row after": way.first_s,
            "rows that differ": float(way.wrong),
        }


def plain_loop(paths: Sequence[Path]) -> tuple[dict[str, Row], float]:
    """The loop that a user would write: load, analyse, append; rows by path, and the time."""
    analyse(load_study(paths[0]))  # imports
    analyses = {}
    begin = time.perf_counter()
    for path in paths:
        analysis = analyse(load_study(path))
        analyses[str(path)] = row_of(analysis, study=str(path))
    took = time.perf_counter() - begin
    return {s: replace(row, content=content_digest(Path(s))) for s, row in analyses.items()}, took


def wrong_rows(out: Path, truth: dict[str, Row]) -> int:
    """Number of good rows missing, duplicated, surplus or not bit-identical to the plain loop's."""
    rows = [replace(row, time_s=0.0) for row in read_fleet(out) if row.is_good]
    found = {row.study: row for row in rows}
    wrong = sum(found.get(study) != row for study, row in truth.items())
    return wrong + len(rows) - len(found) + len(found.keys() - truth.keys())


def harmed(
    folder: Path, paths: Sequence[Path], truth: dict[str, Row], address: str
) -> tuple[Summary, int]:
    """The batch with five studies without an answer, and a worker killed in the middle."""
    from distributed import Client

    bad = poison(folder / "bad", paths[0])
    step = len(paths) // len(bad)
    mixed = list(paths)
    for k, path in enumerate(bad):
        mixed.insert((k + 1) * step, path)
    with Client(address, set_as_default=False) as client:
        victim = next(iter(client.run(os.getpid).values()))
    killed: list[int] = []

    def kill(progress: Progress) -> None:
        if not killed and progress.done >= progress.studies // 2:
            killed.append(victim)
            os.kill(victim, signal.SIGKILL)

    harm = folder / "harm"
    harm.mkdir()
    (harm / "sitecustomize.py").write_text(HARM, "utf-8")
    before = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = os.pathsep.join([str(harm), *([before] if before else [])])
    try:
        out = folder / "harmed.parquet"
        summary = analyse_fleet(mixed, out, scheduler=address, limits=Limits(time_s=5.0), progress=kill)
    finally:
        if before is None:
            del os.environ["PYTHONPATH"]
        else:
            os.environ["PYTHONPATH"] = before
    wrong = wrong_rows(out, truth)
    expected = sorted(["refused"] * 3 + ["time", "crash"])
    wrong += [row.study for row in read_fleet(out)] != [str(path) for path in mixed]
    wrong += sorted(row.failure for row in summary.failures) != expected
    return summary, wrong + (not killed)


def poison(folder: Path, whole: Path) -> list[Path]:
    """Five studies without an answer."""
    folder.mkdir()
    study = load_study(whole)
    for name in ("nan", "missing"):
        save_study(study, folder / name)
    file = folder / "nan" / "records" / "01.csv"
    lines = file.read_text("utf-8").splitlines()
    lines[9] = "nan" + lines[9][lines[9].index(",") :]
    file.write_text("\n".join(lines), "utf-8")
    (folder / "missing" / "records" / "02.csv").unlink()
    save_study(study, folder / "endless.zip")
    data = (folder / "endless.zip").read_bytes()
    (folder / "deadly.zip").write_bytes(data)
    (folder / "broken.zip").write_bytes(data[: len(data) // 2])
    return [folder / name for name in ("nan", "missing", "endless.zip", "deadly.zip", "broken.zip")]


@contextmanager
def cluster() -> Iterator[str | None]:
    """The address of a scheduler with two workers in processes of their own; None without Dask."""
    try:
        from distributed import LocalCluster
    except ImportError:
        yield None
        return
    settings: dict[str, Any] = {"n_workers": WORKERS, "threads_per_worker": 1, "processes": True}
    with LocalCluster(**settings, dashboard_address=None, silence_logs=50) as local:
        yield local.scheduler_address


# --- the studies


def make_studies(folder: Path, count: int) -> list[Path]:
    """Write studies of robots that all differ, as .zip."""
    paths = []
    for seed in range(count):
        paths.append(folder / f"{seed:05d}.zip")
        save_study(robot_study(seed), paths[-1], record_format="parquet")
    return paths


def robot_study(seed: int) -> Study:
    """Steady sines of a robot of one to three joints, with noise."""
    rng = np.random.default_rng(seed)
    n = 1 + seed % 3
    elasticity = Elasticity(K=rng.uniform(5.0, 60.0, n), D=rng.uniform(0.01, 0.1, n))
    coupling = rng.uniform(-0.0004, 0.0004, (n, n))
    M2 = np.diag(rng.uniform(0.002, 0.008, n)) + np.triu(coupling, 1) + np.triu(coupling, 1).T
    inertia = Inertia(M=rng.uniform(0.001, 0.003, n), M2=M2)
    frequencies = np.repeat(FREQUENCIES_HZ, n)
    omega = 2 * np.pi * frequencies
    torque = np.exp(2j * np.pi * rng.random((omega.size, n)))
    angle = np.einsum("rij,rj->ri", motor_response(omega, inertia, elasticity), torque)
    angle /= -(omega[:, None] ** 2)
    t = np.arange(int(RATE_HZ)) / RATE_HZ
    records = []
    for w, q, tau in zip(omega, angle, torque, strict=True):
        turn = np.exp(1j * w * t)[:, None]
        noise = rng.standard_normal((2, t.size, n))
        theta = (turn * q).imag + 2e-5 * np.abs(q) * noise[0]
        records.append(SineRecord(float(w / (2 * np.pi)), t, theta, (turn * tau).imag + 2e-3 * noise[1]))
    return Study(
        tuple(records),
        inertia,
        name=f"cell {seed}",
        robot=f"robot {seed % 20}",
        date=datetime.date(2026, 1, 1) + datetime.timedelta(days=seed // 20),
        origin="simulated",
    )


def main() -> None:
    """Print the table, and write it as JSON when asked."""
    parser = argparse.ArgumentParser(description="A fleet of studies.")
    parser.add_argument("--studies", type=int, default=1000)
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args()
    tables = measure(studies=options.studies)
    for table in tables:
        print(table.markdown())
    if options.json:
        text = json.dumps([table.plain() for table in tables], indent=1, ensure_ascii=False)
        options.json.write_text(text + "\n", "utf-8")


if __name__ == "__main__":
    main()
