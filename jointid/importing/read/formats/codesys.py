"""Traces of CODESYS and the controllers built on it: .trace (XML) and .csv.

The file states milliseconds or microseconds: the XML as ``MicroSeconds``, the CSV as a bit of ``Flags``.
"""

import re

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.importing.columns.log_table import LogTable, require_few_values
from jointid.importing.read.clocks import Signal, tables_of_signals
from jointid.importing.read.reader import Reader, file_text, text_matches
from jointid.importing.read.text.tables import columns_of

_VARIABLE = re.compile(
    r'<TraceVariable\b[^>]{0,400}?\bVarName="([^"]{1,400})"[^>]{0,400}>\s*<Values>([^<]*)</Values>\s*'
    r"<Timestamps>([^<]*)</Timestamps>"
)
_MICROSECONDS = re.compile(r'Name="MicroSeconds"[^>]{0,200}>\s*True\s*<', re.IGNORECASE)
_XML = r"(?s:.{0,400}<Trace>|.*<TraceConfiguration)"
_CSV = r"\s*\[key\]\s*;\s*\[value\]|\s*0\.Variable;"
_CSV_NAME = re.compile(r"\d+\.Variable;(.*)")
_MICROSECOND_FLAG = 32
_NO_SAMPLES = "is a trace without samples: save the trace with its values."


def read_xml(file: str, path: str) -> tuple[LogTable, ...]:
    """Read a trace saved as .trace or .xml.

    Its XML is searched, not parsed: entities and links to other files have no effect.
    """
    text = file_text(path)
    step = 1e-6 if _MICROSECONDS.search(text) else 1e-3
    signals = []
    for name, values, stamps in _VARIABLE.findall(text):
        require_few_values(file, values.count(",") + stamps.count(","))
        pair = _floats(file, name, stamps) * step, _floats(file, name, values)
        # The last sample of a running trace may lack one of the two.
        size = min(part.size for part in pair)
        signals.append(Signal(name, pair[0][:size], pair[1][:size]))
    return tables_of_signals(file, signals, otherwise=f"{file} {_NO_SAMPLES}")


def read_csv(file: str, path: str) -> tuple[LogTable, ...]:
    """Read a trace saved as .csv: for each variable a block of lines "; time; value"."""
    blocks: list[tuple[str, dict[int, str]]] = []
    step = 1e-3
    for number, line in enumerate(file_text(path).split("\n"), start=1):
        if found := _CSV_NAME.match(line):
            blocks.append((found[1].strip(), {}))
        elif line.startswith(";") and blocks:
            blocks[-1][1][number] = line[1:].replace(" ", "")
        elif line.partition(";")[0].rpartition(".")[2].strip() == "Flags":
            flags = line.partition(";")[2].strip()
            step = 1e-6 if flags.isdigit() and int(flags) & _MICROSECOND_FLAG else step
    signals = []
    for name, numbered in blocks:
        if numbered:
            columns = columns_of(file, [*numbered.values()], ("time", name), first_line=min(numbered))
            signals.append(Signal(name, columns[0] * step, columns[1]))
    return tables_of_signals(file, signals, otherwise=f"{file} {_NO_SAMPLES}")


def _floats(file: str, name: str, text: str) -> Floats:
    words = {"true": 1.0, "false": 0.0, "": np.nan}
    values = []
    for number, cell in enumerate(text.split(",") if text.strip() else [], start=1):
        plain = cell.strip().lower()
        try:
            values.append(words[plain] if plain in words else float(plain))
        except ValueError:
            raise JointIdError(
                f'{file}, value {number} of {name:.100}: "{cell:.40}" is not a number. Save the trace '
                "again."
            ) from None
    return np.array(values)


READERS = {
    "codesys": Reader("a CODESYS trace", text_matches(_XML), read_xml, ("trace",)),
    "codesys-csv": Reader("a CODESYS trace", text_matches(_CSV), read_csv),
}
