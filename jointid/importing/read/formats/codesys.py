"""Traces of CODESYS and the controllers built on it: .trace (XML) and .csv.

The file states milliseconds or microseconds: the XML as ``MicroSeconds``, the CSV as a bit of ``Flags``.
"""

from __future__ import annotations

import re

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.importing.columns.log_table import LogTable, require_few_values
from jointid.importing.read.clocks import Signal, tables_of_signals
from jointid.importing.read.reader import Reader, file_text, text_of
from jointid.importing.read.text.delimited import columns_of

_VARIABLE = re.compile(
    r'<TraceVariable\b[^>]{0,400}?\bVarName="([^"]{1,400})"[^>]{0,400}>\s*<Values>([^<]*)</Values>\s*'
    r"<Timestamps>([^<]*)</Timestamps>"
)
_MICROSECONDS = re.compile(r'Name="MicroSeconds"[^>]{0,200}>\s*True\s*<', re.IGNORECASE)
_CSV_NAME = re.compile(r"\d+\.Variable;(.*)")
_MICROSECOND_FLAG = 32


def read_xml(file: str, path: str) -> tuple[LogTable, ...]:
    """Read a trace saved as .trace or .xml.

    Its XML is searched, not parsed: entities and links to other files have no effect.

    Raises
    ------
    JointIdError
        When it holds no samples, or a list has a word in place of a number.
    """
    text = file_text(path)
    step = 1e-6 if _MICROSECONDS.search(text) else 1e-3
    signals = []
    for name, values, stamps in _VARIABLE.findall(text):
        require_few_values(file, values.count(",") + stamps.count(","))
        pair = _floats(file, name, stamps) * step, _floats(file, name, values)
        size = min(
            part.size for part in pair
        )  # the last sample of a running trace may lack one of the two
        signals.append(Signal(name, pair[0][:size], pair[1][:size]))
    return _tables(file, signals)


def read_csv(file: str, path: str) -> tuple[LogTable, ...]:
    """Read a trace saved as .csv: for each variable a block of lines "; time; value".

    Raises
    ------
    JointIdError
        When it holds no samples, or a cell without a number.
    """
    blocks: list[tuple[str, list[str]]] = []
    step = 1e-3
    for line in file_text(path).split("\n"):
        if found := _CSV_NAME.match(line):
            blocks.append((found[1].strip(), []))
        elif line.startswith(";") and blocks:
            blocks[-1][1].append(line[1:].replace(" ", ""))
        elif line.partition(";")[0].rpartition(".")[2].strip() == "Flags":
            flags = line.partition(";")[2].strip()
            step = 1e-6 if flags.isdigit() and int(flags) & _MICROSECOND_FLAG else step
    signals = []
    for name, rows in blocks:
        if rows:
            decimal = "," if any("," in row for row in rows[:2000]) else "."
            time, values = columns_of(f"{file}, {name}", rows, ";", decimal, 2)
            signals.append(Signal(name, time * step, values))
    return _tables(file, signals)


def _tables(file: str, signals: list[Signal]) -> tuple[LogTable, ...]:
    tables = tables_of_signals(file, signals)
    if not tables:
        raise JointIdError(f"{file} is a trace without samples: save the trace with its values.")
    return tables


def _floats(file: str, name: str, text: str) -> Floats:
    words = {"true": "1", "false": "0", "": "nan"}
    cells = [cell.strip() for cell in text.split(",")] if text.strip() else []
    try:
        return np.array([float(words.get(cell.lower(), cell)) for cell in cells])
    except ValueError as error:
        raise JointIdError(
            f"{file}: {name:.100} holds a value that is no number ({error!s:.80})."
        ) from error


def _is_xml(head: bytes) -> bool:
    text = text_of(head)
    return "<Trace>" in text[:400] or "<TraceConfiguration" in text


def _is_csv(head: bytes) -> bool:
    return re.match(r"\s*\[key\]\s*;\s*\[value\]|\s*0\.Variable;", text_of(head)) is not None


READERS = {
    "codesys": Reader("a CODESYS trace", _is_xml, read_xml, ("trace",)),
    "codesys-csv": Reader("a CODESYS trace", _is_csv, read_csv),
}
