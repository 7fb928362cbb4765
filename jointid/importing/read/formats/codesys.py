"""Traces of CODESYS and the controllers built on it: .trace (XML) and .csv.

The file states milliseconds or microseconds: the XML as ``MicroSeconds``, the CSV as a bit of ``Flags``.
"""

import re
from collections.abc import Iterator

from jointid.importing.columns.log_table import LogTable
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
    signals: list[Signal] = []
    for name, values, stamps in _VARIABLE.findall(text):
        # The last sample of a running trace may lack one of the two.
        cells = ("".join(text.split()).split(",") for text in (stamps, values))
        rows = [f"{stamp};{value}" for stamp, value in zip(*cells, strict=False)]
        signals += _signal(f"{file}: samples of {name:.100}", name, rows, step)
    return tables_of_signals(file, signals, otherwise=f"{file} {_NO_SAMPLES}")


def read_csv(file: str, path: str) -> tuple[LogTable, ...]:
    """Read a trace saved as .csv: for each variable a block of lines "; time; value"."""
    blocks: list[tuple[str, dict[int, str]]] = []
    step = 1e-3
    for number, line in enumerate(file_text(path).split("\n"), start=1):
        if found := _CSV_NAME.match(line):
            blocks.append((found[1].strip(), {}))
        elif line.startswith(";") and blocks:
            blocks[-1][1][number] = line[1:]
        elif line.partition(";")[0].rpartition(".")[2].strip() == "Flags":
            flags = line.partition(";")[2].strip()
            step = 1e-6 if flags.isdigit() and int(flags) & _MICROSECOND_FLAG else step
    signals: list[Signal] = []
    for name, numbered in blocks:
        signals += _signal(file, name, [*numbered.values()], step, min(numbered, default=1))
    return tables_of_signals(file, signals, otherwise=f"{file} {_NO_SAMPLES}")


def _signal(
    where: str, name: str, rows: list[str], step_s: float, first_line: int = 1
) -> Iterator[Signal]:
    """Signal of rows "time; value", if there are any."""
    text = re.sub(r"[^\S\n]", "", "\n".join(rows))
    rows = re.sub("(?i)false", "0", re.sub("(?i)true", "1", text)).split("\n")
    if any(row.strip(";") for row in rows):
        time, values = columns_of(where, rows, ("time", name), first_line=first_line)
        yield Signal(name, time * step_s, values)


READERS = {
    "codesys": Reader("a CODESYS trace", text_matches(_XML), read_xml, ("trace",)),
    "codesys-csv": Reader("a CODESYS trace", text_matches(_CSV), read_csv),
}
