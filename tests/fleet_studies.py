"""Hundreds of small studies of varied robots, and files that harm the process that opens them."""

from __future__ import annotations

import datetime
import os
import subprocess
import sys
from collections.abc import Generator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from plants import campaign, motion

from jointid import Elasticity, Inertia, SineRecord, Study, save_study
from jointid.fleet import worker
from jointid.fleet.jobs import Done, Job

ROOT = Path(__file__).parents[1]
RATE_HZ = 400.0

POISON = """
import os, signal, sys, time
def look(event, arguments):
    if event != "open" or not isinstance(arguments[0], (str, bytes)):
        return
    name = os.path.basename(os.fsdecode(arguments[0]))
    if name == "hangs.zip":
        time.sleep(1e6)
    if name == "crashes.zip":
        os.kill(os.getpid(), signal.SIGSEGV)
    if name == "greedy.zip":
        bytearray(1 << 40)
sys.addaudithook(look)
"""
"""As sitecustomize.py, it makes the files of these names hang, kill or overfill whoever opens them."""


def small_study(seed: int) -> Study:
    """Steady sines with noise, of a robot of one or two joints that no other seed has."""
    rng = np.random.default_rng(seed)
    n = 1 + seed % 2
    K, D = rng.uniform(5, 50, n), rng.uniform(0.01, 0.1, n)
    M2 = np.diag(rng.uniform(0.002, 0.006, n)) + 0.0004 * (1 - np.eye(n))
    inertia, elasticity = Inertia(rng.uniform(0.001, 0.003, n), M2), Elasticity(K, D)
    frequencies, tau = campaign([4.0, 9.0, 16.0, 25.0], n)
    q = motion(inertia, elasticity, frequencies, tau)
    time = np.arange(int(RATE_HZ)) / RATE_HZ
    records = []
    for f, a, b in zip(frequencies, q, tau, strict=True):
        turn = np.exp(2j * np.pi * f * time)[:, None]
        theta, torque = (turn * a).imag, (turn * b).imag
        noise = rng.standard_normal((2, time.size, n))
        theta = theta + 1e-5 * np.abs(a) * noise[0]
        records.append(SineRecord(float(f), time, theta, torque + 1e-3 * noise[1]))
    day = datetime.date(2026, 1, 1) + datetime.timedelta(days=seed)
    return Study(
        records, inertia, name=f"cell {seed}", robot=f"robot {seed % 3}", date=day, origin="simulated"
    )


def write_studies(folder: Path, count: int) -> list[Path]:
    """``count`` studies as 0.zip, 1.zip ..., every fifth as a folder; in the order of their numbers."""
    paths = []
    for seed in range(count):
        path = folder / (f"{seed}" if seed % 5 == 4 else f"{seed}.zip")
        save_study(small_study(seed), path, record_format="parquet" if seed % 3 else "csv")
        paths.append(path)
    return paths


def poison(folder: Path) -> dict[str, Path]:
    """Five studies without an answer, by what is wrong with them."""
    study = small_study(1)
    save_study(study, folder / "nan")
    file = folder / "nan" / "records" / "01.csv"
    lines = file.read_text("utf-8").splitlines()
    lines[7] = "nan" + lines[7][lines[7].index(",") :]
    file.write_text("\n".join(lines), "utf-8")
    save_study(study, folder / "missing")
    (folder / "missing" / "records" / "02.csv").unlink()
    save_study(replace(study, name="whole"), folder / "broken.zip")
    data = (folder / "broken.zip").read_bytes()
    for name in ("hangs", "crashes"):
        (folder / f"{name}.zip").write_bytes(data)
    (folder / "broken.zip").write_bytes(data[: len(data) // 2])
    names = {"nan": "nan", "missing": "missing"}
    names |= {name: f"{name}.zip" for name in ("broken", "hangs", "crashes")}
    return {name: folder / file for name, file in names.items()}


class Here:
    """Worker processes that are this process, where processes are not what a test is about."""

    def __init__(self, *_: object, **__: object) -> None: ...

    def run(self, jobs: Sequence[Job]) -> Generator[Done, None, None]:
        for job in jobs:
            yield Done(job, worker.study_row(job.source, job.study, job.method, job.known))


def with_poison(folder: Path) -> dict[str, str]:
    """Environment in which POISON is at work."""
    folder.mkdir(exist_ok=True)
    (folder / "sitecustomize.py").write_text(POISON, "utf-8")
    return os.environ | {"PYTHONPATH": f"{folder}{os.pathsep}{ROOT}", "PYTHONIOENCODING": "utf-8"}


_COMMAND = """
import runpy, signal
signal.signal(signal.SIGINT, signal.default_int_handler)
runpy.run_module("jointid", run_name="__main__", alter_sys=True)
"""


def batch(*arguments: object, env: dict[str, str]) -> subprocess.Popen[str]:
    """The command, begun; it obeys Ctrl-C even where the tests run in the background of a shell."""
    return subprocess.Popen(
        [sys.executable, "-c", _COMMAND, "batch", *(str(a) for a in arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=env,
    )
