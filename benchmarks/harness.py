"""Shared by all benchmarks: interleaved timing, a table, and a description of the machine."""

from __future__ import annotations

import gc
import math
import os
import platform
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module, metadata
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

Cell = str | float | None
LIBRARIES = (
    "jointid", "numpy", "scipy", "pandas", "pyarrow", "pymunk", "streamlit", "plotly", "numba", "pyFRF",
    "mujoco", "distributed",
)  # fmt: skip
NOT_INSTALLED = "not installed"


@dataclass(frozen=True)
class Table:
    """Results of one part: a line per contender, a column per figure."""

    name: str
    """Of the part, for JSON."""
    title: str
    columns: Mapping[str, str]
    """Heading of each column and its number format, or "ms"."""
    rows: tuple[Mapping[str, Cell], ...]
    notes: tuple[str, ...] = ()
    """Sentences under the table on the meaning and limits of the figures."""

    def __post_init__(self) -> None:
        for row in self.rows:
            if set(row) - set(self.columns):
                raise ValueError(f"{self.title}: no column for {set(row) - set(self.columns)}.")

    def markdown(self) -> str:
        """Return the table as in the documentation."""
        lines = [f"**{self.title}**", "", _line(self.columns), _line(["---"] * len(self.columns))]
        for row in self.rows:
            lines.append(_line(written(row.get(c), form) for c, form in self.columns.items()))
        return "\n".join([*lines, *(f"\n{note}" for note in self.notes)])

    def plain(self) -> dict[str, Any]:
        """Return the table as JSON can hold it, its numbers unrounded."""
        rows = [{c: _finite(value) for c, value in row.items()} for row in self.rows]
        return {"name": self.name, "title": self.title, "rows": rows, "notes": list(self.notes)}


def print_rows(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table as Markdown, each row as soon as it is measured."""
    print(_line(headings), _line(["---"] * len(headings)), sep="\n")
    for row in rows:
        print(_line(row), flush=True)


def _line(cells: Any) -> str:
    return "| " + " | ".join(cells) + " |"


def _finite(value: Cell) -> Cell:
    if isinstance(value, int | float | np.number):
        return float(value) if math.isfinite(value) else None
    return value


def written(value: Cell, form: str) -> str:
    """A number in the column's format; texts are unchanged, missing values empty."""
    if value is None:
        return ""
    if isinstance(value, str):
        return value
    if not math.isfinite(value):
        return "–"
    if form == "ms":
        digits = 2 - math.floor(math.log10(max(1e3 * value, 1e-3)))
        return f"{1e3 * value:,.{max(0, digits)}f} ms"
    return format(value, form)


@dataclass(frozen=True)
class Timing:
    """Times of one contender, a number per round in which it ran."""

    seconds: np.ndarray
    against: np.ndarray
    """Its time over that of the contender compared with, in the same round."""

    @property
    def median(self) -> float:
        return float(np.median(self.seconds))

    @property
    def spread(self) -> str:
        """Distance of the quartiles of its rounds from their median, and the number of rounds."""
        low, high = np.percentile(self.seconds, [25, 75]) / self.median - 1
        return f"{100 * low:+.0f} … {100 * high:+.0f} % of {self.seconds.size}"

    @property
    def ratio(self) -> float:
        """Median over the rounds of the ratio within a round: a disturbance slows both alike."""
        return float(np.median(self.against))


def interleaved(
    contenders: Mapping[str, Callable[[], object]],
    *,
    against: str,
    rounds: int = 9,
    patience_s: float = 8.0,
    warm: bool = True,
) -> dict[str, Timing]:
    """Time all contenders in turn, A B C A B C …, in this process.

    Parameters
    ----------
    contenders
        Calls by name.
    against : str
        Whose time is the unit of ``ratio``. It runs in every round.
    rounds : int
        How often each runs, at most.
    patience_s : float
        A contender that has used this much time skips the remaining rounds.
    warm : bool
        Whether each runs once untimed before: compiles, plans and caches are then ready.
    """
    times: dict[str, list[float]] = {name: [] for name in contenders}
    ratios: dict[str, list[float]] = {name: [] for name in contenders}
    if warm:
        for call in contenders.values():
            call()
    for _ in range(rounds):
        spent = {}
        gc.collect()
        gc.disable()
        try:
            for name, call in contenders.items():
                if name == against or sum(times[name]) < patience_s:
                    begin = time.perf_counter()
                    call()
                    spent[name] = time.perf_counter() - begin
        finally:
            gc.enable()
        for name, seconds in spent.items():
            times[name].append(seconds)
            ratios[name].append(seconds / spent[against])
    return {name: Timing(np.array(times[name]), np.array(ratios[name])) for name in contenders}


def beside(
    slow: Callable[[Any], np.ndarray], unit: Callable[[Any], object], data: Sequence[Any]
) -> tuple[np.ndarray, Timing]:
    """Time ``slow`` once for each of the data; ``unit`` runs right before and after it.

    The mean of both is the unit of the ratio.
    """
    found, seconds, ratios = [], [], []
    for each in data:
        before = _seconds(unit, each)
        begin = time.perf_counter()
        found.append(slow(each))
        seconds.append(time.perf_counter() - begin)
        ratios.append(2 * seconds[-1] / (before + _seconds(unit, each)))
    return np.array(found), Timing(np.array(seconds), np.array(ratios))


def _seconds(call: Callable[[Any], object], each: Any) -> float:
    """Median of three."""
    times = []
    for _ in range(3):
        begin = time.perf_counter()
        call(each)
        times.append(time.perf_counter() - begin)
    return float(np.median(times))


def optional(name: str) -> ModuleType | None:
    """Import an optional library."""
    try:
        return import_module(name)
    except ImportError:
        return None


def versions() -> dict[str, str]:
    """Version of every compared library that is installed."""
    found = {}
    for name in LIBRARIES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = NOT_INSTALLED
    return found


def machine() -> dict[str, Cell]:
    """Machine of the measurements."""
    return {
        "cpu": _cpu(),
        "cores": float(os.cpu_count() or 1),
        "memory_GB": _memory_bytes() / 1e9,
        "system": platform.system(),
        "python": platform.python_version(),
        "load_at_start": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
    }


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    return next((x.split(":", 1)[1].strip() for x in lines if x.startswith("model name")), "unknown")


def _memory_bytes() -> float:
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):
        return math.nan


def rms(values: Sequence[float] | np.ndarray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(np.abs(values)))))
