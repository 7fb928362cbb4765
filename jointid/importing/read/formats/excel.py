"""Excel workbooks (.xlsx, .xlsm, .xlsb, .xls) and OpenDocument sheets: one table per sheet."""

import datetime
import io
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from jointid.errors import JointIdError, import_optional
from jointid.importing.columns.log_table import MAX_TABLES, LogTable, most_first, require_few_values
from jointid.importing.read.formats.tidy import long_tables
from jointid.importing.read.reader import Reader, begins_with
from jointid.importing.read.text.tables import read_text_table
from jointid.wording import listed

_MAX_UNPACKED = 128 << 20


def read(file: str, path: str) -> tuple[LogTable, ...]:
    """Read every sheet of a workbook that holds a table of numbers."""
    calamine = import_optional("python_calamine", "python-calamine", "Excel files")
    _require_small(file, path)
    workbook = calamine.CalamineWorkbook.from_filelike(io.BytesIO(Path(path).read_bytes()))
    tables: list[LogTable] = []
    problems: list[str] = []
    held = 0
    for name in workbook.sheet_names[:MAX_TABLES]:
        sheet = workbook.get_sheet_by_name(name)
        held += sheet.total_height * sheet.total_width
        require_few_values(file, held)
        rows = sheet.to_python(skip_empty_area=False)
        if not any(any(cell != "" for cell in row) for row in rows):
            continue
        # As text, a sheet gets the same search for header, units and numbers as a CSV file.
        text = "\n".join("\t".join(_cell(cell) for cell in row) for row in rows)
        try:
            sheet_tables = long_tables(f"{file}: {name}", text.replace('"', "'"))
            sheet_tables = sheet_tables or (read_text_table(f"{file}: {name}", text.encode()),)
            tables += [replace(table, row_word="row") for table in sheet_tables]
        except JointIdError as error:
            problems.append(str(error))
    if not tables:
        reason = problems[0] if problems else f"{file}: all sheets are empty."
        raise JointIdError(f"{reason} Sheets found: {listed(workbook.sheet_names)}.")
    return most_first(file, tables)


def _require_small(file: str, path: str) -> None:
    """Refuse a workbook by the size that its parts unpack to."""
    if not zipfile.is_zipfile(path):
        return
    with zipfile.ZipFile(path) as archive:
        size = sum(part.file_size for part in archive.infolist())
    if size > _MAX_UNPACKED:
        raise JointIdError(
            f"{file} unpacks to {size / 2**20:.4g} MiB, more than the limit of "
            f"{_MAX_UNPACKED >> 20} MiB for workbooks (about 4 million cells). "
            "Export it as CSV or Parquet, or cut it into several logs."
        )


def _cell(cell: Any) -> str:
    if isinstance(cell, bool):
        return str(int(cell))
    if isinstance(cell, datetime.timedelta):
        cell = cell.total_seconds()
    elif type(cell) is datetime.date:  # midnight, in a column of times
        cell = datetime.datetime.combine(cell, datetime.time())
    return " ".join(str(cell).split())


READERS = {
    "excel": Reader(
        "a workbook",
        begins_with(b"PK\x03\x04", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"),
        read,
        ("xlsx", "xlsm", "xlsb", "xls", "ods"),
    )
}
