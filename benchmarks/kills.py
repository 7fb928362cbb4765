"""Kill -9 of the server, a batch and a conversion while they write: nothing lost, half written or left over.

    python -m benchmarks.kills [count of each] [server] [batch] [convert]

A victim is killed at a random time, or, every second time, as soon as a file is being written. What it
had acknowledged must be there, bit for bit, and the next run must go on and leave no ``.new`` or ``.old``.
"""

from __future__ import annotations

import os
import random
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from benchmarks.harness import Table
from jointid import load_study, save_study
from jointid.files import atomic_write
from jointid.files.digest import study_digest
from jointid.files.store import Store, new_workspace
from jointid.files.study_files import pack_study
from jointid.fleet.journal import journal_path
from jointid.fleet.table import read_fleet

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))
COLUMNS = {"victim": "", "kills": ".0f", "during a write": ".0f", "lost": ".0f", "half written": ".0f",
           "left over": ".0f"}  # fmt: skip
PARTS = ("server", "batch", "convert")


def writing(folder: Path) -> list[Path]:
    """What is being written anywhere in a folder, or was left over."""
    return [*folder.rglob(".*.new"), *folder.rglob(".*.old")]


def killed(process: subprocess.Popen[bytes], folder: Path, until_s: float, at_write: bool) -> bool:
    """Kill a process at a random time or at a write; True when it was writing. False if it had ended."""
    end = time.monotonic() + random.uniform(0, until_s) * (3 if at_write else 1)
    while time.monotonic() < end and process.poll() is None:
        if at_write and writing(folder):
            break
        time.sleep(0.0005)
    process.kill()
    process.wait()
    return bool(writing(folder))


def swept(folder: Path, write: Callable[[], object]) -> int:
    """How many files are left after the next write."""
    for left in writing(folder):
        os.utime(left, (time.time() - 60,) * 2)  # a write takes left-overs of some age
    write()
    return len(writing(folder))


def jointid(*arguments: object) -> subprocess.Popen[bytes]:
    """Start the command line; a victim has a group of its own, which its workers leave by themselves."""
    command = [sys.executable, "-m", "jointid.cli", *map(str, arguments)]
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    return subprocess.Popen(command, cwd=ROOT, **silent)


def batch(count: int, folder: Path) -> Counter[str]:
    """Kill batches that go on from each other; a complete one must have every row."""
    from fleet_studies import write_studies

    paths = write_studies(folder, 12)
    out, found, truth = folder / "rows.parquet", Counter[str](), None
    acknowledged = 0
    while found["kills"] < count:
        process = jointid("batch", *paths, "--out", out, "--workers", 1)
        found["during a write"] += killed(process, folder, 4.0, found["kills"] % 2 == 1)
        found["kills"] += process.returncode != 0
        journal = journal_path(out)
        lines = journal.read_bytes().count(b"\n") if journal.exists() else 0
        if out.exists():
            rows = {row.path: (row.K, row.D) for row in read_fleet(out)}
            truth = truth or rows
            found["half written"] += rows != truth
            out.unlink()
            journal.unlink(missing_ok=True)
            lines = 0
        else:
            found["lost"] += lines < acknowledged
        acknowledged = lines
    end = jointid("batch", *paths, "--out", out, "--workers", 1)
    end.wait()
    found["lost"] += len(read_fleet(out)) != len(paths)
    found["left over"] += swept(folder, lambda: atomic_write.write_file(folder / "x", b"")) + journal.exists()
    return found


def convert(count: int, folder: Path) -> Counter[str]:
    """Kill conversions into a zip and a folder that replace an earlier study."""
    from log_makers import write_log_of

    log, mapping, inertia = write_log_of(load_study(ROOT / "sample_data" / "paper.zip"), folder)
    found = Counter[str]()
    for target in (folder / "study.zip", folder / "study"):
        given = ("convert", log, "--mapping", mapping, "--inertia", inertia, "-o", target, "--overwrite")
        jointid(*given).wait()
        truth = study_digest(load_study(target))
        for k in range(count // 2):
            begin = time.monotonic()
            process = jointid(*given)
            found["during a write"] += killed(process, folder, 4.0, k % 2 == 1)
            found["kills"] += process.returncode != 0
            del begin
            if not target.exists():
                found["left over"] += swept(folder, lambda: jointid(*given).wait())
            found["lost"] += not target.exists()
            found["half written"] += target.exists() and study_digest(load_study(target)) != truth
        found["left over"] += swept(folder, lambda: jointid(*given).wait())
    return found
