"""JSON: one object per line, an array of objects, or an object of arrays."""

import json
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from jointid.errors import JointIdError
from jointid.importing.columns.log_table import MAX_COLUMNS, LogTable, require_few_values
from jointid.importing.read.array_tables import FEWEST_ROWS
from jointid.importing.read.formats.tidy import long_tables
from jointid.importing.read.reader import Reader, file_text, text_matches
from jointid.importing.read.text.tables import read_text_table
from jointid.wording import counted

_DEEPEST = 6
_MOST_VALUES = 8_000_000
"""Upper limit of values in a file; each takes some 100 bytes of memory while it is read."""


def read(file: str, path: str) -> tuple[LogTable, ...]:
    """Read rows of named numbers; points join nested names, an index names elements of lists."""
    text = file_text(path)
    if text.count(",") > _MOST_VALUES:
        raise JointIdError(
            f"{file} holds more than {_MOST_VALUES / 1e6:g} million values, the limit for JSON: export "
            "it as CSV or Parquet."
        )
    rows, notes = _rows(file, text)
    names: dict[str, int] = {}
    table: list[dict[str, str]] = []
    for row in rows:
        cells = dict(_cells("", row, _DEEPEST))
        for name in cells:
            names.setdefault(name, len(names))
        if len(names) > MAX_COLUMNS:
            raise JointIdError(f"{file} has more than {MAX_COLUMNS} different names: log fewer signals.")
        table.append(cells)
        if len(table) & 0xFFF == 0:
            require_few_values(file, len(table) * len(names))
    require_few_values(file, len(table) * len(names))
    # As text, rows get the same search for units, times of day and numbers as a CSV file.
    text = "\n".join("\t".join(cells.get(name, "") for name in names) for cells in table)
    header = "\t".join(" ".join(name.split()) or "name" for name in names)
    whole = f"{header}\n{text}\n"
    found = long_tables(file, whole.replace('"', "'"))  # marks within a name quote nothing
    found = found or (read_text_table(file, whole.encode("utf-8", "replace")),)
    return tuple(replace(t, notes=(*notes, *t.notes), first_row=1, row_word="row") for t in found)


def _rows(file: str, text: str) -> tuple[list[dict[str, Any]], list[str]]:
    """Objects of a file, and notes."""
    lines = [line for line in text.split("\n") if line.strip()]
    try:
        if _is_object(lines[0]) and (len(lines) > 1 and _is_object(lines[1])):
            return _line_objects(file, lines)
        whole = json.loads(text)
    except JointIdError:
        raise
    except (ValueError, RecursionError) as error:
        raise JointIdError(f"{file} is not JSON ({error!s:.120}): export the log again.") from error
    names: list[str] = []
    if isinstance(whole, dict) and all(isinstance(whole.get(key), list) for key in ("columns", "data")):
        names, whole = [*map(str, whole["columns"])], whole["data"]  # as pandas splits a table
    if isinstance(whole, list):
        labels = names or [f"column {k}" for k in range(1, MAX_COLUMNS)]
        whole = [dict(zip(labels, row, strict=False)) if isinstance(row, list) else row for row in whole]
    if isinstance(whole, dict):
        lists = dict(_lists("", whole, _DEEPEST))
        sizes = [len(v) for v in lists.values()]
        if sizes and max(sizes) >= FEWEST_ROWS:
            size = max(sizes, key=lambda rows: rows * sizes.count(rows))
            kept = {k: v for k, v in lists.items() if len(v) == size}
            return [dict(zip(kept, row, strict=True)) for row in zip(*kept.values(), strict=True)], []
        whole = next((v for v in lists.values() if v and isinstance(v[0], dict)), [whole])
    if isinstance(whole, list) and whole and all(isinstance(row, dict) for row in whole):
        return whole, []
    raise JointIdError(f"{file} holds no rows: expected an object of names and numbers on every line.")


def _lists(name: str, value: Any, depth: int) -> Iterator[tuple[str, list[Any]]]:
    """Columns of nested objects; one may be an object of values by row, as pandas writes it."""
    if isinstance(value, list):
        yield name, value
    elif isinstance(value, dict) and depth:
        if name and not any(isinstance(inner, dict | list) for inner in value.values()):
            yield name, [*value.values()]
        else:
            for key, inner in value.items():
                yield from _lists(f"{name}.{key}".strip("."), inner, depth - 1)


def _line_objects(file: str, lines: list[str]) -> tuple[list[dict[str, Any]], list[str]]:
    rows: list[dict[str, Any]] = []
    for number, line in enumerate(lines, start=1):
        try:
            row = json.loads(line)
        except (ValueError, RecursionError):
            if number == len(lines):
                return rows, [
                    f"The last line ({counted(len(line), 'character')}) is cut short and was left out."
                ]
            raise JointIdError(
                f"{file}, row {number}: {line[:60]!r} is not JSON. Repair or remove the line."
            ) from None
        if isinstance(row, dict):
            rows.append(row)
    return rows, []


def _is_object(line: str) -> bool:
    line = line.strip()
    return line.startswith("{") and line.endswith("}")


def _cells(name: str, value: Any, depth: int) -> Iterator[tuple[str, str]]:
    if isinstance(value, dict) and depth:
        for key, inner in value.items():
            yield from _cells(f"{name}.{key}"[:200] if name else str(key)[:200], inner, depth - 1)
    elif isinstance(value, list) and depth:
        for index, inner in enumerate(value[:MAX_COLUMNS]):
            yield from _cells(f"{name}[{index}]", inner, depth - 1)
    elif isinstance(value, bool):
        yield name, str(int(value))
    elif isinstance(value, float | str):
        yield name, " ".join(str(value).split())[:64]
    elif isinstance(value, int) and value.bit_length() < 1000:
        yield name, str(value)


READERS = {"json": Reader("JSON", text_matches(r"\s*(?:\{|\[\s*[\[{])"), read, ("jsonl", "ndjson"))}
