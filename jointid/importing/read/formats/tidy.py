"""Long ("tidy") text tables: one value per row, with its time and the name of its signal."""

import csv
from array import array
from itertools import islice

import numpy as np

from jointid.errors import JointIdError
from jointid.importing.columns.column_words import WORDS, words_of
from jointid.importing.columns.log_table import MAX_COLUMNS, LogTable, require_few_values
from jointid.importing.columns.units import split_unit, unit_of
from jointid.importing.read.clocks import Signal, tables_of_signals
from jointid.importing.read.reader import Reader, file_text, text_of
from jointid.importing.read.text.clock_times import ClockCells, is_clock
from jointid.importing.read.text.numbers import is_number, value_of
from jointid.wording import counted, listed

_LINES = {
    "name": "signal variable name channel topic key tag series measurement metric symbol kanal field id",
    "value": "value values wert val valeur valor valore data reading messwert",
    "unit": "unit units einheit",
}
_WORDS = {kind: frozenset(line.split()) for kind, line in _LINES.items()}


def read(file: str, path: str) -> tuple[LogTable, ...]:
    """Read a long table; every signal keeps its own times."""
    lines = file_text(path).split("\n")
    layout = _layout("\n".join(lines[:40]))
    assert layout is not None  # that is how it was recognised
    first, separator, decimal, (time_at, name_at, value_at, unit_at), time_name = layout
    require_few_values(file, 2 * len(lines))
    found: dict[str, tuple[array[float], array[int], str]] = {}
    strange: list[int] = []
    clock = ClockCells()
    times: array[float] = array("d")
    clocked = any(":" in line for line in lines[first : first + 3])
    rows = csv.reader(lines[first:], delimiter=separator)
    for number, row in enumerate(rows, start=first + 1):
        if not any(row):
            continue
        cells = [cell.strip() for cell in row]
        if len(cells) <= max(time_at, name_at, value_at):
            strange.append(number)
            continue
        stamp = clock.read(cells[time_at]) if clocked else _value(cells[time_at], decimal)
        value = _value(cells[value_at], decimal)
        times.append(np.nan if stamp is None else stamp)
        if stamp is None or value is None:
            strange.append(number)
            continue
        unit = cells[unit_at] if 0 <= unit_at < len(cells) else ""
        values, places, _ = found.setdefault(cells[name_at][:200], (array("d"), array("q"), unit))
        places.append(len(times) - 1)
        values.append(value)
        if len(found) >= MAX_COLUMNS:
            raise JointIdError(f"{file} names more than {MAX_COLUMNS} signals: log fewer of them.")
    notes = []
    if strange:
        notes.append(
            f"{counted(len(strange), 'row')} without a time or number left out; "
            f"the first is line {strange[0]}."
        )
    bare, unit = split_unit(time_name)
    of_day = clock.seconds(np.array(times)) if clocked and len(times) else np.array(times)
    signals = [
        Signal(name, of_day[np.array(places)], np.array(values), unit_of(unit))
        for name, (values, places, unit) in found.items()
    ]
    otherwise = f"{file} holds no rows with a time, a name and a number. Signals: {listed(found)}."
    times_as = bare or "time", "s" if clocked else unit
    return tables_of_signals(file, signals, notes, times_as, otherwise)


def _value(cell: str, decimal: str) -> float | None:
    return value_of(cell, decimal) if is_number(cell, decimal) else None


def _layout(head: str) -> tuple[int, str, str, tuple[int, int, int, int], str] | None:
    """Line of the first row, separator, decimal mark, columns of time, name, value and unit; or None."""
    lines = head.split("\n")
    for separator in (";", "\t", ",", "|"):
        for at, line in enumerate(lines[:10]):
            header = [cell.strip().strip('"') for cell in line.split(separator)]
            words = [set(words_of(split_unit(cell)[0])) for cell in header]
            if not 3 <= len(header) <= 8:
                continue
            places = [
                next((k for k, w in enumerate(words) if w & wanted and len(w) <= 2), -1)
                for wanted in (WORDS["time"], *_WORDS.values())
            ]
            if min(places[:3]) < 0 or len(set(places[:3])) < 3:
                continue
            try:
                rows = [
                    r
                    for r in islice(csv.reader(lines[at + 1 : -1], delimiter=separator), 20)
                    if len(r) == len(header)
                ]
            except csv.Error:
                continue
            for decimal in (".", ",") if separator != "," else (".",):
                good = [
                    (is_number(row[places[0]].strip(), decimal) or is_clock(row[places[0]].strip()))
                    and is_number(row[places[2]].strip(), decimal)
                    and not is_number(row[places[1]].strip(), decimal)
                    for row in rows
                ]
                if good and sum(good) >= 0.8 * len(good):
                    return (
                        at + 1,
                        separator,
                        decimal,
                        (places[0], places[1], places[2], places[3]),
                        header[places[0]],
                    )
    return None


def _recognises(head: bytes) -> bool:
    return b"\0" not in head[2:200:2] + head[3:200:2] and _layout(text_of(head)) is not None


READERS = {"tidy": Reader("a long table", _recognises, read)}
