"""TOML tables with typed keys; each error names file, table and key."""

from __future__ import annotations

import datetime
import math
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from typing import Any, TypeVar

from jointid.errors import JointIdError
from jointid.wording import nearest, shown

T = TypeVar("T")

MAX_TOML_BYTES = 1 << 20
"""Largest TOML file that is parsed, bytes."""

_LARGEST = 1e300  # above it, an integer may exceed what a float can hold

# The parser's memory grows with the square of a dotted key's length: one line of 200 kB fills gigabytes.
_KEY = r"""(?:"(?:[^"\\\n]|\\.){0,200}+"|'[^'\n]{0,200}+'|[\w-]{1,200}+)"""
_LONG_DOTTED_KEY = re.compile(rf"(?<![\w-]){_KEY}(?:[ \t]*+\.[ \t]*+{_KEY}){{32}}")


class CheckedTable:
    """One TOML table; every message about it begins with ``where``."""

    def __init__(
        self, file: str, values: Mapping[str, object], examples: Mapping[str, str], table: str = ""
    ) -> None:
        """Refuse unknown keys; ``examples`` has every valid key with an example of its value.

        ``table`` is the name as in "[inertia]"; "" for the top of the file.
        """
        self.file = file
        self.where = f"{file}, {table}" if table else file
        self._table = table
        self._values = values
        self._examples = examples
        for key in values:
            if key not in examples:
                raise self.error(
                    f'unknown key "{key[:60]}".{nearest(key, examples)} '
                    f"Valid keys: {', '.join(examples)}."
                )

    def error(self, message: str) -> JointIdError:
        """Return an error about this table."""
        return JointIdError(f"{self.where}: {message}", file=self.file)

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def value(self, key: str) -> Any:
        """Return a value of the type of its example."""
        return getattr(self, _reader(self._examples[key]))(key)

    def values(self, keys: Iterable[str], required: Iterable[str] = ()) -> dict[str, Any]:
        """Return the values of those keys that are there or required."""
        return {key: self.value(key) for key in keys if key in self or key in required}

    def text(self, key: str, default: str | None = None) -> str:
        """Return a string."""
        return self._typed(key, str, "text in quotes", default)

    def flag(self, key: str) -> bool:
        """Return true or false."""
        return self._typed(key, bool, "true or false")

    def integer(self, key: str) -> int:
        """Return a whole number, also of 1.0."""
        value = self._get(key)
        whole = int(value) if isinstance(value, float) and value.is_integer() else value
        if not isinstance(whole, int) or isinstance(whole, bool):
            raise self._wrong_type(key, value, "a whole number")
        return whole

    def number(self, key: str, default: float | None = None) -> float:
        """Return a finite number."""
        return self._number(key, self._get(key, default))

    def deviation(self, key: str) -> float:
        """Return a relative standard deviation: zero, positive or infinite."""
        value = self._get(key)
        if isinstance(value, bool) or not isinstance(value, int | float) or not value >= 0:
            expected = "a relative standard deviation: 0.05 for 5 %, 0 for exact, inf for unknown values"
            raise self._wrong_type(key, value, expected)
        return math.inf if value > _LARGEST else float(value)

    def date(self, key: str) -> datetime.date | datetime.datetime:
        """Return a date, or a date with its time of day."""
        value = self._get(key)
        if not isinstance(value, datetime.date):  # a datetime is one, too; a time of day alone is none
            found = str(value) if isinstance(value, datetime.time) else value
            raise self._wrong_type(key, found, "a date without quotes")
        return value

    def numbers(self, key: str) -> list[float]:
        """Return a list of finite numbers; a single number counts as a list of one."""
        value = self._get(key)
        items = value if isinstance(value, list) else [value]
        return [self._number(key, item, "numbers") for item in items]

    def texts(self, key: str) -> list[str]:
        """Return a list of strings."""
        value = self._typed(key, list, expected := "a list of strings in quotes")
        if not all(isinstance(item, str) for item in value):
            raise self._wrong_type(key, value, expected)
        return value

    def matrix(self, key: str) -> list[list[float]]:
        """Return rows of numbers as in ``numbers``, equally long; a single number is one row of one."""
        value = self._get(key)
        rows = value if isinstance(value, list) else [[value]]
        if not all(isinstance(row, list) and len(row) == len(rows[0]) for row in rows):
            raise self.error(f"{key} must be equally long rows. Example: {self._examples[key]}.")
        return [[self._number(key, item, "rows of numbers") for item in row] for row in rows]

    def table(self, key: str, examples: Mapping[str, str]) -> CheckedTable:
        """Return the table under ``key``."""
        return self._subtable(f"[{key}]", key, self._get(key), examples)

    def named_tables(self, key: str, examples: Mapping[str, str]) -> dict[str, CheckedTable]:
        """Return the tables [key.NAME] by name, none when the key is absent."""
        value = self._typed(key, dict, f"tables [{key}.NAME]", {})
        return {
            name: self._subtable(f"[{key}.{name[:60]}]", key, item, examples)
            for name, item in value.items()
        }

    def tables(self, key: str, examples: Mapping[str, str]) -> list[CheckedTable]:
        """Return the tables [[key]] in their order."""
        value = self._typed(key, list, f"tables [[{key}]]")
        return [
            self._subtable(f"[[{key}]] number {number}", key, item, examples)
            for number, item in enumerate(value, start=1)
        ]

    def _typed(self, key: str, kind: type[T], expected: str, default: object = None) -> T:
        value = self._get(key, default)
        if not isinstance(value, kind):
            raise self._wrong_type(key, value, expected)
        return value

    def _get(self, key: str, default: object = None) -> object:
        value = self._values.get(key, default)
        if value is None:
            raise self.error(f"{key} is missing. Example: {self._examples[key]}.")
        return value

    def _number(self, key: str, value: object, expected: str = "a number") -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self._wrong_type(key, value, expected)
        try:
            number = float(value)
        except OverflowError:  # an integer beyond 1.8e308
            number = math.inf
        if not math.isfinite(number):
            raise self.error(f"{key} holds {number}; every value must be finite.")
        return number

    def _subtable(self, name: str, key: str, value: object, examples: Mapping[str, str]) -> CheckedTable:
        if not isinstance(value, dict):
            raise self._wrong_type(key, value, f"a table {name}")
        inside = f"{self._table}, {name}" if self._table else name
        return CheckedTable(self.file, value, examples, inside)

    def _wrong_type(self, key: str, value: object, expected: str) -> JointIdError:
        return self.error(
            f"{key} must be {expected}; got {shown(value)}. Example: {self._examples[key]}."
        )


@contextmanager
def in_place(where: str, file: str) -> Iterator[None]:
    """Put the place of a refused value before its message, unless the message names the file."""
    try:
        yield
    except JointIdError as error:
        if error.file == file:
            raise
        raise error.within(where, file=file) from error


@cache
def _reader(example: str) -> str:
    """Method for values of the type of an example: "numbers" for "K = [20.0, 3.5]"."""
    (value,) = tomllib.loads(example).values()
    kinds = {str: "text", bool: "flag", int: "number", float: "number", datetime.date: "date"}
    return f"{kinds[type(value[0])]}s" if isinstance(value, list) else kinds[type(value)]


def parse_toml(file: str, data: bytes, examples: Mapping[str, str]) -> CheckedTable:
    """Parse a TOML file, UTF-8; ``examples`` has every valid top-level key with an example of its value.

    Raises JointIdError when it is not UTF-8 or not TOML, too large, or has an unknown key.
    """
    return CheckedTable(file, toml_values(file, data), examples)


def toml_values(file: str, data: bytes) -> dict[str, Any]:
    """Return the values of a TOML file; errors as in ``parse_toml``, without unknown keys."""
    if len(data) > MAX_TOML_BYTES:
        raise JointIdError(
            f"{file} has {len(data)} bytes, more than the limit of {MAX_TOML_BYTES}: "
            "keep measurements in record files.",
            file=file,
        )
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise JointIdError(
            f"{file}, line {line}: not UTF-8 text.",
            file=file,
            line=line,
            hint="Save the file with the encoding UTF-8.",
        ) from error
    if match := _LONG_DOTTED_KEY.search(text):
        line = text.count("\n", 0, match.start()) + 1
        raise JointIdError(
            f"{file}, line {line}: a key of more than 32 dotted parts: shorten it.",
            file=file,
            line=line,
        )
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise JointIdError(f"{file}: brackets are nested too deeply.", file=file) from None
    except ValueError as error:
        raise JointIdError(f"{file} is not valid TOML: {error!s:.200}.", file=file) from error
