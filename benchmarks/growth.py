"""Growth of time and memory with the length of a record, the number of records and of joints.

Every size is measured in a process of its own, so that its peak memory is its own. Records up to ten
million samples are in memory; one of a hundred million comes from a Parquet file, as in a study on disk.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.campaign import INERTIA, TRUTH
from benchmarks.harness import Cell, Table
from jointid import (
    Controller,
    Elasticity,
    Excitation,
    Inertia,
    Measurement,
    Motion,
    MotionRecord,
    Phasors,
    SineRecord,
    extract_phasors,
    identify_elasticity,
    identify_motion,
    load_study,
    simulate_motion,
    simulate_records,
)
from jointid.motion.spectra import motion_phasors

ROOT = Path(__file__).parents[1]
FULL = {
    "samples": (1e3, 1e4, 1e5, 1e6, 1e7),
    "samples, Parquet": (1e7, 1e8),
    "samples, motion": (2e4, 4e4, 8e4, 1.6e5, 3.2e5),
    "records": (4, 16, 64, 256, 1024, 4096),
    "joints": (1, 2, 3, 4, 6, 8),
}
QUICK = {
    "samples": (1e3, 1e4),
    "samples, Parquet": (1e4,),
    "samples, motion": (1e4,),
    "records": (4, 8),
    "joints": (2,),
}
APART = "samples, Parquet"
"""Sizes that the quick run measures in processes of their own; the rest in this one."""
COLUMNS = {
    "grows": "",
    "size": ",.0f",
    "phasors": "ms",
    "K and D": "ms",
    "peak memory above imports": "",
    "the data themselves": "",
    "exponent": "",
}
RATE_HZ = 1000.0
NOISE = Measurement(position_noise_rad=1e-5, torque_noise_Nm=0.01)


def measure(quick: bool) -> list[Table]:
    """Table of all sizes."""
    series = {
        what: [
            _in_a_process(what, size, quick)
            if not quick or what == APART
            else _measured(what, int(size), ROOT, 1)
            for size in sizes
        ]
        for what, sizes in (QUICK if quick else FULL).items()
    }
    rows: list[dict[str, Cell]] = []
    for what, points in series.items():
        for i, point in enumerate(points):
            rows.append(
                {
                    "grows": what,
                    "size": point["size"],
                    "phasors": point["phasors"],
                    "K and D": point["identify"],
                    "peak memory above imports": f"{point['memory_MB']:.1f} MB",
                    "the data themselves": f"{point['data_MB']:.1f} MB",
                    "exponent": _exponents(points) if i == len(points) - 1 else None,
                }
            )
    return [Table("growth", "Growth", COLUMNS, tuple(rows), (NOTE,))]


NOTE = (
    "Exponent: slope of the logarithm of time over that of size between the last three sizes; 1 is "
    "linear. Records: 2,000 samples each. Joints: 72 records of 2,000 samples, so the data grow with "
    "the joints as well. Parquet: from opening the study to its phasors, a part at a time in memory. "
    "Motion: two records of random motion of that many samples each, from the records to K and D."
)


def exponent(points: Sequence[dict[str, Any]], key: str) -> float:
    """Slope over the last three sizes, where constant parts hardly count."""
    last = [p for p in points if p[key]][-3:]
    if len(last) < 2:
        return float("nan")
    return float(np.polyfit(np.log([p["size"] for p in last]), np.log([p[key] for p in last]), 1)[0])


def _exponents(points: Sequence[dict[str, Any]]) -> str:
    names = {"phasors": "phasors", "identify": "K and D"}
    slopes = {name: exponent(points, key) for key, name in names.items()}
    return ", ".join(f"{name} {slope:.2f}" for name, slope in slopes.items() if np.isfinite(slope))


def _in_a_process(what: str, size: float, quick: bool) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        if what == "samples, Parquet":
            _write_parquet(Path(folder), int(size))
        command = [sys.executable, "-m", "benchmarks.growth", what, str(int(size)), folder]
        done = subprocess.run(
            [*command, str(1 if quick else 5)], cwd=ROOT, capture_output=True, text=True, check=False
        )
    if done.returncode:
        raise RuntimeError(f"{what} {size:g}: {done.stderr.strip().splitlines()[-1]}")
    return dict(json.loads(done.stdout))


def _measured(what: str, size: int, folder: Path, repeats: int) -> dict[str, Any]:
    """Measure one size, without imports and preparation."""
    warm = _records_of(RATE_HZ, 2, 1000)
    extract_phasors([warm])
    imports_MB = _held_MB("VmRSS")
    inertia: Inertia | None = None
    identify: Callable[[], object] | None = None
    if what == "samples, Parquet":
        repeats = 1 if size > 1e7 else repeats
        data_MB = 40.0 * size / 1e6

        def extract() -> Phasors:
            return extract_phasors(load_study(folder).records)

    elif what == "samples, motion":
        motions, data_MB = _motions(size), 2 * 40.0 * size / 1e6
        identify = partial(identify_motion, motions, INERTIA)

        def extract() -> Phasors:
            return motion_phasors(motions, np.tile(INERTIA.M, (len(motions), 1)))

    else:
        records, inertia = _make(what, size)
        data_MB = sum(8 * (1 + 2 * r.n) * r.time_s.size for r in records) / 1e6

        def extract() -> Phasors:
            return extract_phasors(records)

    _forget_peak()
    seconds, found = _timed(extract, repeats)
    if inertia is not None:
        identify = partial(identify_elasticity, found, inertia)
    return {
        "size": size,
        "phasors": seconds,
        "identify": identify and _timed(identify, min(repeats, 3))[0],
        "memory_MB": _held_MB("VmHWM") - imports_MB,
        "data_MB": data_MB,
    }


def _timed(call: Callable[[], Any], repeats: int) -> tuple[float, Any]:
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        found = call()
        times.append(time.perf_counter() - begin)
    return float(np.median(times)), found


def _records_of(rate_hz: float, joints: int, samples: int) -> SineRecord:
    """One record, quick to make: sines with noise."""
    rng = np.random.default_rng(3)
    t = np.arange(samples) / rate_hz
    signal = 1e-4 * rng.standard_normal((samples, 2 * joints))
    signal += np.sin(2 * np.pi * 3.3 * t)[:, None] * rng.uniform(0.5, 1.0, 2 * joints)
    return SineRecord(3.3, t, signal[:, :joints], signal[:, joints:])


def _motions(samples: int) -> tuple[MotionRecord, ...]:
    """Two records of two joints."""
    motion = Motion("random", duration_s=samples / RATE_HZ)
    controller = Controller(sample_rate_hz=RATE_HZ)
    return simulate_motion(INERTIA, TRUTH, motion, controller=controller, measurement=NOISE)


def _make(what: str, size: int) -> tuple[tuple[SineRecord, ...], Inertia | None]:
    if what == "samples":
        return (_records_of(RATE_HZ, 2, size),), None
    joints = size if what == "joints" else 2
    M2 = 0.004 * np.eye(joints) + 0.0004 * (np.eye(joints, k=1) + np.eye(joints, k=-1))
    inertia = Inertia(M=np.linspace(0.0025, 0.001, joints), M2=M2)
    elasticity = Elasticity(K=np.linspace(40.0, 20.0, joints), D=np.full(joints, 0.08))
    count = 72 if what == "joints" else size
    per_frequency = 12 if what == "joints" else 2
    records = simulate_records(
        inertia,
        elasticity,
        np.geomspace(3.0, 30.0, count // per_frequency),
        excitation=Excitation(duration_s=2.0, records_per_frequency=per_frequency),
        controller=Controller(sample_rate_hz=RATE_HZ),
        measurement=NOISE,
        seed=5,
    )
    return records, inertia


def _write_parquet(folder: Path, samples: int) -> None:
    """A study of one record, written in parts; not in the process that is measured."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    names = ["time_s", "theta_m1_rad", "theta_m2_rad", "tau_m1_Nm", "tau_m2_Nm"]
    schema = pa.schema([(name, pa.float64()) for name in names])
    rng = np.random.default_rng(8)
    part = 1 << 20
    noise = 1e-4 * rng.standard_normal(
        (part, 4)
    )  # the same in every part, which does not change the reading
    with pq.ParquetWriter(
        folder / "01.parquet", schema, compression="none", use_dictionary=False
    ) as file:
        for begin in range(0, samples, part):
            k = np.arange(begin, min(begin + part, samples))
            sine = np.sin(2 * np.pi * 3.3 * k / RATE_HZ)
            columns = [k / RATE_HZ, *(sine[:, None] * [1.0, 0.8, 0.5, 0.6] + noise[: k.size]).T]
            file.write_table(pa.table(dict(zip(names, columns, strict=True)), schema=schema))
    (folder / "study.toml").write_text(
        'format = 1\nname = "Long"\n[inertia]\nM = [0.0025, 0.001]\n'
        "M2 = [[0.004104, 0.000395], [0.000395, 0.001889]]\n"
        '[[records]]\nfile = "01.parquet"\nfrequency_hz = 3.3\n',
        "utf-8",
    )


def _held_MB(which: str) -> float:
    """Memory of this process: "VmRSS" now, "VmHWM" at most since ``_forget_peak``.

    The kernel's ru_maxrss is unsuitable: it starts at the memory of the parent process.
    """
    try:
        lines = Path("/proc/self/status").read_text("utf-8").splitlines()
    except OSError:  # not on Linux
        return float("nan")
    return next(int(line.split()[1]) / 1e3 for line in lines if line.startswith(which))


def _forget_peak() -> None:
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", "utf-8")


if __name__ == "__main__":
    what, size, folder, repeats = sys.argv[1:]
    print(json.dumps(_measured(what, int(size), Path(folder), int(repeats))))
