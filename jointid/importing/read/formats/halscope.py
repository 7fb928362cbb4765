"""Captures saved by LinuxCNC's halscope, which states the sampling period in the first line."""

import re

import numpy as np

from jointid.errors import JointIdError
from jointid.importing.columns.log_table import LogTable
from jointid.importing.read.clocks import Signal, tables_of_signals
from jointid.importing.read.reader import Reader, file_text, text_matches
from jointid.importing.read.text.tables import columns_of

_HEAD = re.compile(r"#? ?Sampling period is (\d{1,12}) n(?:Sec|s)")
_PAIR = re.compile(r"(\S{1,200})\s{1,9}([-+]\S{1,60})")


def read(file: str, path: str) -> tuple[LogTable, ...]:
    """Read a capture: names and values side by side (older versions), or a header and semicolons."""
    first, *rest = file_text(path).split("\n")
    found = _HEAD.match(first)
    assert found is not None  # recognised by it
    period_s = int(found[1]) * 1e-9
    lines = ["" if row.startswith("#") else row for row in rest]
    head = next((k for k, row in enumerate(lines) if row.strip()), len(lines))
    if period_s == 0 or head == len(lines):
        raise JointIdError(f"{file} has no samples, or a sampling period of 0: save the capture again.")
    if pairs := _PAIR.findall(lines[head]):
        names = [name for name, _ in pairs]
        lines = [";".join(value for _, value in _PAIR.findall(row)) for row in lines]
    else:
        names, lines[head] = lines[head].split(";"), ""
    notes: list[str] = []
    columns = columns_of(file, lines, names, first_line=2, notes=notes)
    time = np.arange(len(columns[0]), dtype=np.float64) * period_s
    signals = [Signal(n, time, v) for n, v in zip(names, columns, strict=True)]
    return tables_of_signals(file, signals, notes)


READERS = {"halscope": Reader("a halscope capture", text_matches(_HEAD.pattern), read)}
