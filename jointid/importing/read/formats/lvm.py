"""LabVIEW measurement files (.lvm): segments of text with units, X0, Delta_X and decimal commas."""

import re
from itertools import pairwise

import numpy as np

from jointid.errors import JointIdError
from jointid.importing.columns.log_table import MAX_TABLES, LogTable, most_first
from jointid.importing.read.array_tables import Signal, tables_of_signals
from jointid.importing.read.reader import Reader, file_text, text_matches
from jointid.importing.read.text.tables import columns_of

_END = "***End_of_Header***"


def read(file: str, path: str) -> tuple[LogTable, ...]:
    """Read every segment; segments of the same channels that follow each other in time are one table."""
    text = file_text(path)
    head, ended, rest = text.partition(_END)
    if not ended:
        raise JointIdError(f"{file}: the header does not end: the file is cut off. Export it again.")
    separator = found[1] if (found := re.search(r"^Separator([\t,;])", head, re.MULTILINE)) else "\t"
    main = dict(line.split(separator)[:2] for line in head.split("\n") if separator in line)
    decimal = main.get("Decimal_Separator", ".").strip() or "."
    if decimal not in (".", ",") or decimal == separator:
        raise JointIdError(f'{file}: Decimal_Separator = "{decimal:.5}"; expected a point or a comma.')
    parts = rest.split(_END)
    runs: list[list[list[Signal]]] = []
    # What precedes the end of a segment's header is the previous segment's data, then the header.
    for number, (before, body) in enumerate(pairwise(parts), start=1):
        where = f"{file}: segment {number}"
        x_columns = main.get("X_Columns", "One").strip()
        header, rows = before.split("\n"), body.split("\n")[1:]
        starts = [k for k, line in enumerate(header) if line.startswith("Channels")]
        ends = [k for k, line in enumerate(rows) if line.startswith("Channels")]
        header = header[starts[-1] :] if starts else header
        rows = [line for line in rows[: ends[0] if ends else None] if line.strip()]
        signals = _segment(where, header, rows, separator, decimal, x_columns)
        if signals and runs and _goes_on(runs[-1][-1], signals):
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


def _goes_on(before: list[Signal], after: list[Signal]) -> bool:
    """Whether the samples of a segment follow those of the one before, of the same channels."""
    return [s.name for s in before] == [s.name for s in after] and all(
        b.time_s[0] > a.time_s[-1] for a, b in zip(before, after, strict=True)
    )


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


def _segment(
    where: str, header: list[str], rows: list[str], separator: str, decimal: str, x_columns: str
) -> list[Signal]:
    about = {cells[0].strip(): cells[1:] for cells in (line.split(separator) for line in header)}
    if len(rows) < 2:
        return []
    names = [name.strip() for name in rows[0].split(separator)]
    width = len(names) - (names[-1] in ("Comment", ""))
    columns = columns_of(where, rows[1:], separator, decimal, width)

    def of(key: str, channel: int, default: float) -> float:
        cells = about.get(key, [])
        try:
            return float(cells[channel].replace(decimal, "."))
        except (IndexError, ValueError):
            return default

    signals: list[Signal] = []
    time = columns[0]
    for k, name in enumerate(names[:width]):
        channel = len(signals)
        if name == "X_Value":
            time = columns[k]
            continue
        delta = of("Delta_X", channel, 0.0)
        if x_columns == "No":
            if delta <= 0:
                raise JointIdError(
                    f"{where}: {name} has neither times nor a Delta_X above 0: export it again."
                )
            time = of("X0", channel, 0.0) + delta * np.arange(len(columns[k]), dtype=np.float64)
        known = np.isfinite(time) & np.isfinite(columns[k])
        units = about.get("Y_Unit_Label", [])
        unit = units[channel].strip() if channel < len(units) else ""
        if known.any():
            signals.append(Signal(name, time[known], columns[k][known], unit))
    return signals


READERS = {
    "lvm": Reader("a LabVIEW measurement", text_matches(r"\s*LabVIEW Measurement"), read, ("lvm",))
}
