"""Text exports of Beckhoff's TwinCAT Scope: rows of properties, then times and values side by side."""

import re
from typing import Any

import numpy as np

from jointid.errors import JointIdError
from jointid.importing.columns.column_words import RATED_SHARE, in_thousandths
from jointid.importing.columns.log_table import LogTable
from jointid.importing.read.clocks import Signal, tables_of_signals
from jointid.importing.read.reader import Reader, file_text, text_matches
from jointid.importing.read.text.numbers import number_or
from jointid.importing.read.text.tables import columns_of
from jointid.wording import listed

_HEAD = re.compile(
    r"\A\s*Name([;,\t|: ])(?:.*\1Name\1"
    r"|.*\n(?:.*\n){1,40}?\s*(?:Starttime of export|SampleTime\[ms\]|SymbolName|NetI[Dd])\1)"
)
_INTEGERS = ("INT", "BIT", "BOOL", "BYTE", "WORD", "DINT")
_TICK_S = 1e-7  # FILETIME counts 100 ns
_NUMBER = re.compile(r"[-+]?\d[\d.,eE+-]*")
_FULL_STAMP = 1e15  # a relative time in ms is far below


def read(file: str, path: str) -> tuple[LogTable, ...]:
    """Read a TwinCAT Scope export; every channel keeps its own clock."""
    text = file_text(path)
    head = _HEAD.match(text)
    assert head is not None  # recognised by it
    separator = head[1]
    rows = text.split("\n")
    start, about = _channel_rows(rows, separator)
    names = about["Name"]
    body = [row for row in rows[start:] if row.strip() != "EOF"]
    if not body or "Name" not in names:
        raise JointIdError(f"{file} holds no samples with times: export the recording with its times.")
    cells = body[0].split(separator)
    # A column headed by "Name" holds the times of the channels to its right.
    clocks = [k for k, name in enumerate(names) if name.strip() == "Name"]
    full = {k for k in clocks if k < len(cells) and cells[k].isdigit() and int(cells[k]) > _FULL_STAMP}
    columns = columns_of(file, body, names, separator=separator, first_line=start + 1, integers=full)
    origin = min((int(columns[k][columns[k] > 0].min()) for k in full), default=0)
    if len(names) != len(about.get("VariableSize", names)):
        raise JointIdError(
            f"{file} has {separator!r} between columns and in names of channels: export it with tabs "
            "or semicolons."
        )
    signals, notes, time = [], [], None
    for k, name in enumerate(names):
        if k in clocks:
            ticks = np.where(columns[k] > 0, columns[k] - origin, np.nan) if k in full else None
            time = columns[k] * 1e-3 if ticks is None else ticks * _TICK_S
        elif time is not None and name.strip():
            of_channel = {key: row[k].strip() for key, row in about.items() if k < len(row)}
            values, note = _scaled(columns[k], of_channel)
            notes += [f'"{name.strip()}": {note}'] if note else []
            kept = np.isfinite(time) & np.isfinite(values)
            unit = of_channel.get("Unit", "").partition(" (")[0]
            symbol = of_channel.get("SymbolName", "")
            if not unit and not RATED_SHARE.search(name) and in_thousandths(symbol, values):
                unit = "‰"
                notes.append(
                    f'"{name.strip()}": whole numbers of the symbol "{symbol}" are read as '
                    "thousandths of the rated value, as in CiA 402."
                )
            signals.append(Signal(name.strip(), time[kept], values[kept], unit))
    otherwise = f"{file} holds no samples. Channels: {listed(names)}."
    return tables_of_signals(file, signals, notes, otherwise=otherwise)


def _channel_rows(rows: list[str], separator: str) -> tuple[int, dict[str, list[str]]]:
    """First line after the channels' properties, and those by name, one entry per column."""
    about: dict[str, list[str]] = {}
    for number, row in enumerate(rows[:2000]):  # comments of symbols may have many lines
        cells = [cell.strip() for cell in row.split(separator)]
        key = cells[0]
        if key == "Name" and "SampleTime[ms]" not in about:
            about = {key: cells}  # the last one is that of the channels, the first that of the scope
        elif not _NUMBER.match(key):
            about.setdefault(key, cells)
        elif about and sum(bool(_NUMBER.fullmatch(cell)) for cell in cells) > max(len(cells) / 2, 1):
            return number, about
    return len(rows), about


def _scaled(values: Any, about: dict[str, str]) -> tuple[Any, str]:
    """Values in the channel's unit, and a note where the export does not say whether it scaled them."""
    pairs = [("ScaleFactor", "Offset"), ("Unit ScaleFactor", "Unit Offset")]
    factors = [(number_or(about.get(a, ""), 1.0), number_or(about.get(b, ""), 0.0)) for a, b in pairs]
    if all(factor == (1.0, 0.0) for factor in factors):
        return values, ""
    said = ", ".join(f"factor {a:g} and offset {b:g}" for a, b in factors if (a, b) != (1.0, 0.0))
    whole = about.get("Data-Type", "").upper().startswith(("U", *_INTEGERS))
    product = factors[0][0] * factors[1][0]
    finite = values[np.isfinite(values)]
    if whole and product != round(product) and finite.size and not np.all(finite == np.round(finite)):
        return values, ""  # integers with fractions are scaled already
    if whole and abs(product) < 1 and np.all(finite == np.round(finite)):
        for factor, offset in factors:
            values = values * factor + offset
        return values, f"the channel's {said} are applied, as its values are unscaled integers."
    return values, (
        f"the channel has {said}. The export does not say whether its values include them: they "
        "are used as exported. Check the size of the motion in the figure."
    )


READERS = {"twincat": Reader("a TwinCAT Scope export", text_matches(_HEAD.pattern), read)}
