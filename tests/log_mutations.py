"""Damaged logs of every format, and their outcome."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

from format_makers import FORMATS
from log_makers import (
    cell_log,
    comma_log,
    excel,
    hdf5,
    mat_arrays,
    mat_scope,
    mat_timeseries,
    mat_v73,
    parquet,
    ros1_bag,
    ros_bag,
    zipped,
)

from jointid import JointIdError
from jointid.importing import LogTable, apply_mapping, guess_mapping


def bag(kind: str, folder: Path) -> bytes:
    (file,) = [p for p in ros_bag(folder, kind).iterdir() if p.suffix in (".db3", ".mcap")]
    return file.read_bytes()


KINDS: dict[str, Callable[[Path], bytes]] = {
    "matlab": lambda _: mat_scope(),
    "matlab-plain": lambda _: mat_arrays(),
    "matlab-7.3": lambda _: mat_v73(),
    "hdf5": lambda _: hdf5(),
    "hdf5-table": lambda _: hdf5(compound=True),
    "parquet": lambda _: parquet(),
    "excel": lambda _: excel(),
    "ros-sqlite": lambda folder: bag("sqlite3", folder),
    "ros-mcap": lambda folder: bag("mcap", folder),
    "ros-1": lambda folder: ros1_bag(folder).read_bytes(),
    "matlab-series": lambda _: mat_timeseries(),
    "zip": lambda _: zipped({"a.csv": comma_log(), "b/scope.mat": mat_scope(), "README": b"logs"}),
    "zipped-bag": lambda folder: zipped(
        {f"bag/{part.name}": part.read_bytes() for part in ros_bag(folder, "mcap").iterdir()}
    ),
    **FORMATS,
}
"""A log of every kind, given a folder to make it in."""
TEXTS: dict[str, Callable[[Path], bytes]] = {
    "text-utf-16": lambda _: cell_log("utf-16", 60),
    "text-latin": lambda _: cell_log(rows=60),
    "text-comma": lambda _: comma_log(60),
}


def mutated(data: bytes, rng: random.Random) -> bytes:
    """A few bytes changed, often where the structure is; or a piece cut, doubled or blown up."""
    out = bytearray(data)
    for _ in range(rng.choice([1, 1, 2, 4, 16, 64])):
        place = rng.randrange(min(len(out), 4096)) if rng.random() < 0.5 else rng.randrange(len(out))
        kind = rng.randrange(6)
        if kind == 0:
            out[place] = rng.randrange(256)
        elif kind == 1:
            out[place] ^= 1 << rng.randrange(8)
        elif kind == 2:
            out[place : place + 4] = rng.choice(
                [b"\xff" * 4, b"\0" * 4, b"\xff\xff\xff\x7f", b"\0\0\0\x40"]
            )
        elif kind == 3:
            out[place : place + 8] = rng.randbytes(8)
        elif kind == 4:
            del out[place : place + rng.randrange(1, 64)]
        else:
            out[place:place] = out[place : place + rng.randrange(1, 64)]
        if len(out) < 16:
            break
    if rng.random() < 0.1:
        out = out[: rng.randrange(1, len(out))]
    return bytes(out)


def check(results: object) -> str:
    """Outcome, "refused" or "read"; a table must be usable, or be refused with a reason."""
    if isinstance(results, JointIdError):
        assert len(str(results)) < 3100
        return "refused"
    assert isinstance(results, tuple)
    for table in results:
        assert isinstance(table, LogTable)
        try:
            apply_mapping(table, guess_mapping(table).mapping)
        except JointIdError:
            continue
    return "read"
