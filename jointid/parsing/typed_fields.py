"""Dataclasses from plain values of a file, each checked for the type of its field."""

from collections.abc import Mapping
from dataclasses import MISSING, fields
from functools import cache
from inspect import formatannotation
from typing import Any, TypeVar

T = TypeVar("T")


def typed(kind: type[T], values: Mapping[str, Any]) -> T:
    """Return a dataclass of texts, numbers, truth values and lists of them, which become tuples.

    Raises ValueError when a field is missing, unknown or of another type.
    """
    if not isinstance(values, Mapping):
        raise ValueError(f"{values!r:.60} is no table of values")
    known = _types(kind)  # type: ignore[arg-type]  # a class is hashable
    plain = {name: tuple(v) if isinstance(v, list) else v for name, v in values.items()}
    for name, value in plain.items():
        if name not in known:
            raise ValueError(f'unknown key "{name:.60}"')
        if not _fits(known[name][0], value):
            raise ValueError(f"{name} = {value!r:.60}")
    for name, (_, is_required) in known.items():
        if is_required and name not in plain:
            raise ValueError(f"{name} is missing")
    return kind(**plain)


@cache
def _types(kind: type) -> dict[str, tuple[str, bool]]:
    """Type of each field of a dataclass, and whether it has no default."""
    return {
        f.name: (formatannotation(f.type), f.default is MISSING and f.default_factory is MISSING)
        for f in fields(kind)
    }


def _fits(kind: str, value: object) -> bool:
    """Whether a value has the type of an annotation such as "tuple[float, ...]"."""
    if kind.startswith("tuple["):
        inner = kind.removeprefix("tuple[").partition(",")[0]
        return isinstance(value, tuple) and all(_fits(inner, item) for item in value)
    if kind.endswith(" | None"):
        return value is None or _fits(kind.removesuffix(" | None"), value)
    return type(value).__name__ == kind.strip("'")  # a truth value is no number
