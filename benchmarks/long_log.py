"""``jointid convert`` on long logs of many sine runs: CPU time, peak memory, runs found and missed."""

from __future__ import annotations

import json
import os
import sys
import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np

from benchmarks.harness import Cell, Table
from jointid import Elasticity, Inertia, load_study, motor_response

INERTIA = Inertia(M=(0.0025, 0.0010), M2=((0.004104, 0.000395), (0.000395, 0.001889)))
ELASTICITY = Elasticity(K=(20.0, 3.5), D=(0.10, 0.015))
RATE_HZ = 1000.0
SIZES = ((5, 67), (45, 600))
"""Minutes and runs."""
MAPPING = {
    "format": 1,
    "time": {"column": "t", "unit": "s"},
    "joints": [
        {
            "position": {"column": f"theta_{j}", "unit": "rad", "side": "motor"},
            "torque": {"column": f"tau_{j}", "unit": "N·m", "side": "motor"},
        }
        for j in (1, 2)
    ],
}


def measure(quick: bool) -> list[Table]:
    """One row for each size; every conversion has a process of its own."""
    rows = [_row(*size) for size in (((1, 13),) if quick else SIZES)]
    form = {"log": "", "CPU": ".1f", "peak memory (MB)": ",.0f", "runs": ",d", "found": ",d"}
    form |= {"wrong": ",d", "frequency off by at most (ppm)": ".1f"}
    about = "Wrong: a record that no run contains. One run may become several records."
    return [Table("long_log", "Long logs of sine runs at 1 kHz", form, tuple(rows), (about,))]


def _row(minutes: int, runs: int) -> dict[str, Cell]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        spans = write_log(folder / "log.csv", 60.0 * minutes, runs)
        (folder / "mapping.json").write_text(json.dumps(MAPPING), "utf-8")
        M, M2 = INERTIA.M.tolist(), INERTIA.M2.tolist()
        (folder / "robot.toml").write_text(f"M = {M}\nM2 = {M2}\n", "utf-8")
        command = [
            sys.executable,
            "-m",
            "jointid",
            "convert",
            "log.csv",
            "--mapping",
            "mapping.json",
        ]
        command += ["--inertia", "robot.toml", "--output", "study"]
        process = os.posix_spawn(
            "/usr/bin/env", ["env", "-C", name, *command], {**os.environ, "PYTHONPATH": os.getcwd()}
        )
        _, status, used = os.wait4(process, 0)
        if status:
            raise RuntimeError(f"jointid convert ended with {status}.")
        found = [
            (r.time_s[0], r.time_s[-1], r.frequency_hz) for r in load_study(folder / "study").records
        ]
    off = []
    hit = set()
    for begin, end, hertz in found:
        inside = [k for k, (a, b, _) in enumerate(spans) if a - 0.05 <= begin and end <= b + 0.05]
        hit.update(inside)
        off += [abs(hertz / spans[k][2] - 1) * 1e6 for k in inside]
    return {
        "log": f"{minutes} min, {runs} runs",
        "CPU": used.ru_utime + used.ru_stime,
        "peak memory (MB)": used.ru_maxrss / 1024,
        "runs": runs,
        "found": len(hit),
        "wrong": len(found) - len(off),
        "frequency off by at most (ppm)": max(off, default=float("nan")),
    }


def write_log(
    path: Path, duration_s: float, runs: int, seed: int = 4
) -> list[tuple[float, float, float]]:
    """Write a log of settled and settling sines with rests; return begin, end (s) and frequency (Hz)."""
    rng = np.random.default_rng(4)
    time = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    signals = rng.standard_normal((time.size, 4)) * [2e-5, 2e-5, 2e-3, 2e-3]
    edges = np.linspace(0.5, duration_s - 0.5, runs + 1)
    spans = []
    for begin, end in pairwise(edges):
        hertz = float(np.round(np.exp(rng.uniform(np.log(3.0), np.log(35.0))), 2))
        end -= rng.uniform(0.3, 0.15 * (end - begin) + 0.4)
        torque = rng.uniform(0.3, 1.0, 2) * np.exp(1j * rng.uniform(-np.pi, np.pi, 2))
        omega = 2 * np.pi * hertz
        angle = -(motor_response([omega], INERTIA, ELASTICITY)[0] @ torque) / omega**2
        rows = slice(*np.searchsorted(time, [begin, end]))
        t = time[rows] - begin
        fade = np.clip(np.minimum(t, end - begin - t) * hertz / 1.5, 0, 1)[:, None]
        wave = fade * np.exp(1j * omega * t)[:, None]
        settling = 1 + 0.3 * np.exp(-2 * hertz * t)[:, None]
        signals[rows, :2] += (wave * settling * angle).imag
        signals[rows, 2:] += (wave * torque).imag
        spans.append((float(begin), float(end), hertz))
    table = np.column_stack([time, signals])
    np.savetxt(path, table, "%.9g", ",", header="t_s,theta_1,theta_2,tau_1,tau_2", comments="")
    return spans
