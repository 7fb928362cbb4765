"""A log as some controller wrote it: named columns of numbers, whatever the separator."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import pandas as pd

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.wording import listed

MAX_LOG_BYTES = 100 << 20
"""Largest log that is read; at 1 kHz and ten columns this is about a quarter of an hour."""

_SEPARATORS = ",;\t|"
_SNIFFED_LINES = 60


def read_log(file: str, data: bytes) -> Mapping[str, Floats]:
    """Read the numeric columns of a text table.

    Separator (comma, semicolon, tab, bar), decimal mark, comment lines above the header and the
    encoding (UTF-8, else Latin-1) are found from the file. Columns that hold text are left out.

    Parameters
    ----------
    file : str
        Its name, for messages.
    data : bytes

    Returns
    -------
    mapping of str to ndarray, shape (N,)
        Missing cells are NaN.

    Raises
    ------
    JointIdError
        When it is empty, too large or not a table with at least two columns of numbers.
    """
    if not data.strip():
        raise JointIdError(f"{file} is empty ({len(data)} bytes): export the log again.")
    if len(data) > MAX_LOG_BYTES:
        raise JointIdError(
            f"{file} has {len(data) / 2**20:.4g} MiB, more than the limit of "
            f"{MAX_LOG_BYTES / 2**20:.4g} MiB. Cut it to one sine run."
        )
    if b"\0" in data[:65536]:
        raise JointIdError(f"{file} is not text but binary or UTF-16: export it as CSV in UTF-8.")
    text = _decoded(data)
    separator, header = _layout(file, text)
    decimal = _decimal_mark(text, separator, header)
    try:
        table = pd.read_csv(
            io.StringIO(text),
            sep=separator,
            decimal=decimal,
            skiprows=header,
            skipinitialspace=True,
            index_col=False,
            on_bad_lines="error",
        )
    except (ValueError, pd.errors.ParserError, csv.Error, OverflowError) as error:
        reason = str(error).replace("Error tokenizing data. C error: ", "").strip()
        raise JointIdError(f"{file} cannot be read as a table: {reason}. Repair these lines.") from error
    numeric = table.select_dtypes("number")
    columns = {str(name).strip(): numeric[name].to_numpy(np.float64) for name in numeric}
    if len(columns) < 2:
        raise JointIdError(
            f"{file} has {len(columns)} column(s) of numbers; a log needs time, position and torque. "
            f"Columns found: {listed(str(name) for name in table.columns)}."
        )
    return MappingProxyType(columns)


def _decoded(data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")  # what German controllers write; it never fails


def _layout(file: str, text: str) -> tuple[str, int]:
    """Separator and number of lines above the header: the most cells that most lines agree on."""
    lines = text[: 1 << 16].splitlines()[:_SNIFFED_LINES]
    if len(text) > 1 << 16:
        lines = lines[:-1] or lines
    if not any(lines):
        raise JointIdError(f"{file} begins with {len(lines)} blank lines: export the log again.")
    best, found = (0, 0), ("", 0)
    for separator in _SEPARATORS:
        counts = [line.count(separator) for line in lines]
        written = Counter(c for c, line in zip(counts, lines, strict=True) if line)
        usual, agreeing = written.most_common(1)[0]
        # Decimal commas agree as well, but a separator stands in the header too.
        first = counts.index(usual)
        score = (agreeing if usual else 0, usual)
        if usual and score > best and not _is_number(lines[first].split(separator)[0]):
            best, found = score, (separator, first)
    if not found[0]:
        raise JointIdError(
            f"{file} is not a table with a header: expected named columns, separated by commas, "
            f"semicolons or tabs. First line: {lines[0][:80]!r}."
        )
    return found


def _decimal_mark(text: str, separator: str, header: int) -> str:
    if separator == ",":
        return "."
    cells = [c for line in text[: 1 << 16].splitlines()[header + 1 : -1] for c in line.split(separator)]
    commas = sum("," in cell and _is_number(cell.replace(",", ".")) for cell in cells)
    return "," if commas > sum("." in cell and _is_number(cell) for cell in cells) else "."


def _is_number(cell: str) -> bool:
    try:
        float(cell.strip().strip('"'))
    except ValueError:
        return False
    return True
