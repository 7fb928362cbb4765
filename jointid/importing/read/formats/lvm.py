"""LabVIEW measurement files (.lvm): segments of text with units, X0, Delta_X and decimal commas."""

from __future__ import annotations

import numpy as np

from jointid.errors import JointIdError
from jointid.importing.columns.log_table import MAX_TABLES, LogTable, most_first
from jointid.importing.read.clocks import Signal, tables_of_signals
from jointid.importing.read.reader import Reader, file_text, text_of
from jointid.importing.read.text.delimited import columns_of

_END = "***End_of_Header***"
_FIRST = "LabVIEW Measurement"


def read(file: str, path: str) -> tuple[LogTable, ...]:
    """Read every segment; segments of the same channels that follow each other in time are one table.

    Parameters
    ----------
    file : str
        Its name, for messages.
    path : str

    Raises
    ------
    JointIdError
        When a header is cut, no segment has samples, or a cell has no number.
    """
    text = file_text(path)
    head, found, rest = text.partition(_END)
    if not found:
        raise JointIdError(f"{file}: the header does not end: the file is cut off. Export it again.")
    main = {
        cells[0]: cells[1:]
        for cells in (line.split("\t") for line in head.split("\n"))
        if len(cells) > 1
    }
    named = {"Tab": "\t", "Comma": ","}
    separator = named.get(main.get("Separator", ["Tab"])[0].strip(), "\t")
    if separator != "\t":
        main = {line.partition(separator)[0]: line.split(separator)[1:] for line in head.split("\n")}
    decimal = main.get("Decimal_Separator", ["."])[0].strip() or "."
    x_columns = main.get("X_Columns", ["One"])[0].strip()
    if decimal not in (".", ",") or decimal == separator:
        raise JointIdError(f'{file}: Decimal_Separator = "{decimal:.5}"; expected a point or a comma.')
    parts = rest.split(_END)
    # What precedes the end of a segment's header is the previous segment's data, then the header.
    headers = [_own_header(part) for part in parts[:-1]]
    segments = []
    for number, (header, body) in enumerate(zip(headers, parts[1:], strict=True), start=1):
        rows = _rows(body)
        segments.append(
            _segment(f"{file}: segment {number}", header, rows, separator, decimal, x_columns)
        )
    joined: list[list[Signal]] = []
    for signals in segments:
        last = joined[-1] if joined else []
        if (
            last
            and [s.name for s in last] == [s.name for s in signals]
            and all(b.time_s[0] > a.time_s[-1] for a, b in zip(last, signals, strict=True))
        ):
            joined[-1] = [
                Signal(a.name, np.append(a.time_s, b.time_s), np.append(a.values, b.values), a.unit)
                for a, b in zip(last, signals, strict=True)
            ]
        elif signals:
            joined.append(signals)
    tables = [
        table
        for number, signals in enumerate(joined[:MAX_TABLES], start=1)
        for table in tables_of_signals(
            file if len(joined) == 1 else f"{file}: segment {number}", signals
        )
    ]
    if not tables:
        raise JointIdError(f"{file} holds no samples: export the measurement again.")
    return most_first(file, tables) if len(joined) > 1 else tuple(tables)


def _own_header(part: str) -> list[str]:
    """Lines of the header at the end of a part: from the line "Channels" on."""
    lines = part.split("\n")
    starts = [k for k, line in enumerate(lines) if line.startswith("Channels")]
    return lines[starts[-1] :] if starts else lines


def _rows(body: str) -> list[str]:
    """Lines of names and samples, up to the next segment's header."""
    rows = []
    for line in body.split("\n")[1:]:
        if line.startswith("Channels"):
            break
        if line.strip():
            rows.append(line)
    return rows


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


def _recognises(head: bytes) -> bool:
    return text_of(head[:200]).lstrip().startswith(_FIRST)


READERS = {"lvm": Reader("a LabVIEW measurement", _recognises, read, ("lvm",))}
