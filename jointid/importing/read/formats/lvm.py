"""LabVIEW measurement files (.lvm): segments of text with units, X0, Delta_X and decimal commas."""

import re
from collections.abc import Iterable, Iterator
from itertools import count

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.importing.columns.log_table import MAX_TABLES, LogTable, most_first
from jointid.importing.read.clocks import Signal, tables_of_signals
from jointid.importing.read.reader import Reader, file_text, text_matches
from jointid.importing.read.text.numbers import number_or
from jointid.importing.read.text.tables import columns_of

_END = "***End_of_Header***"


def read(file: str, path: str) -> tuple[LogTable, ...]:
    """Read every segment; segments of the same channels that follow each other in time are one table."""
    lines = file_text(path).split("\n")
    starts, ends = (
        [k for k, line in enumerate(lines) if line.startswith(mark)] for mark in ("Channels", _END)
    )
    if not ends:
        raise JointIdError(f"{file}: the header does not end: the file is cut off. Export it again.")
    head = lines[: ends[0]]
    separator = next((line[9:10] for line in head if re.match(r"Separator[\t,;]", line)), "\t")
    main = dict(line.split(separator)[:2] for line in head if separator in line)
    decimal = main.get("Decimal_Separator", ".").strip() or "."
    if decimal not in (".", ",") or decimal == separator:
        raise JointIdError(f'{file}: Decimal_Separator = "{decimal:.5}"; expected a point or a comma.')
    has_times = main.get("X_Columns", "One").strip() != "No"
    has_times = main.get("X_Columns", "One").strip() != "No"
    runs: list[list[list[Signal]]] = []
    # A segment's header ends as that of the file does; its rows, where the next header begins.
    segments = zip(starts, ends[1:], [*starts[1:], len(lines)], strict=False)
    for number, (start, end, stop) in enumerate(segments, start=1):
        top = next((k for k in range(end + 1, stop) if lines[k].strip()), stop)
        rows = lines[top + 1 : stop]
        if not any(row.strip() for row in rows):
            continue
        names = [name.strip() for name in lines[top].split(separator)]
        names = names[: len(names) - (names[-1] in ("Comment", ""))]
        where = f"{file}: segment {number}"
        columns = columns_of(
            where, rows, names, separator=separator, decimal=decimal, first_line=top + 2
        )
        about = {key.strip(): cells for key, *cells in (x.split(separator) for x in lines[start:end])}
        signals = [*_signals(where, about, zip(names, columns, strict=True), has_times)]
        before_it = runs[-1][-1] if signals and runs else []
        follows = [s.name for s in before_it] == [s.name for s in signals] and all(
            b.time_s[0] > a.time_s[-1] for a, b in zip(before_it, signals, strict=True)
        )
        if signals and follows:
            runs[-1].append(signals)
        elif signals:
            runs.append([signals])
    tables = [
        table
        for number, run in enumerate(runs[:MAX_TABLES], start=1)
        for table in tables_of_signals(
            file if len(runs) == 1 else f"{file}: part {number}", _joined(run)
        )
    ]
    if not tables:
        raise JointIdError(f"{file} holds no samples: export the measurement again.")
    return most_first(file, tables) if len(runs) > 1 else tuple(tables)


def _joined(run: list[list[Signal]]) -> list[Signal]:
    return [
        Signal(
            parts[0].name,
            np.concatenate([part.time_s for part in parts]),
            np.concatenate([part.values for part in parts]),
            parts[0].unit,
        )
        for parts in zip(*run, strict=True)
    ]


def _signals(
    where: str, about: dict[str, list[str]], columns: Iterable[tuple[str, Floats]], has_times: bool
) -> Iterator[Signal]:
    """Signals of a segment, with the entries of its header by channel."""
    time, channels = np.zeros(0), count()
    for name, values in columns:
        if name == "X_Value":
            time = values
            continue
        channel = next(channels)
        entries = {key: cells[channel].strip() for key, cells in about.items() if channel < len(cells)}
        if not has_times or time.size != values.size:
            start, delta = (number_or(entries.get(key, ""), 0.0) for key in ("X0", "Delta_X"))
            if delta <= 0:
                raise JointIdError(
                    f"{where}: {name} has neither times nor a Delta_X above 0: export it again."
                )
            time = start + delta * np.arange(len(values), dtype=np.float64)
        known = np.isfinite(time) & np.isfinite(values)
        if known.any():
            yield Signal(name, time[known], values[known], entries.get("Y_Unit_Label", ""))


READERS = {
    "lvm": Reader("a LabVIEW measurement", text_matches(r"\s*LabVIEW Measurement"), read, ("lvm",))
}
