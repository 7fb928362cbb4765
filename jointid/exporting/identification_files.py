"""An identification as JSON or TOML, and back, equal to the last bit.

Both hold the same document, motor side, SI units, see ``to_document``. Readers ignore
``standard_error``, ``undetermined``, ``units`` and the disagreement of priors, which are for people. An
infinite error, of an undetermined parameter, is null in JSON and "not determined" in TOML; the infinite
standard deviation of an unknown inertia is null and "unknown".
"""

import json
import math
import os
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import tomli_w

from jointid.answer import EFFECT_PARAMETERS
from jointid.errors import JointIdError
from jointid.estimation.elasticity import Friction
from jointid.estimation.estimators.parameters import elasticity_labels
from jointid.exporting.identification import Identification, Obtained
from jointid.files.study_saving import inertia_table
from jointid.gears.gear import Gear
from jointid.joints import Elasticity, Inertia
from jointid.parsing.checked_toml import MAX_TOML_BYTES, toml_values
from jointid.parsing.typed_fields import typed
from jointid.uncertainty.prior_rows import PriorRow
from jointid.wording import UNDETERMINED, shown

T = TypeVar("T")
KIND = "jointid identification"

_UNITS = {
    "K": "N·m/rad",
    "D": "N·m·s/rad",
    "inertia": "kg·m²",
    "coulomb": "N·m",
    "viscous": "N·m·s/rad",
    "delay": "s",
}
_UNKNOWN = "unknown"
_INFINITE = (None, UNDETERMINED, _UNKNOWN)
"""In place of an infinite number."""
_TOML_WORDS = {
    "disagreement": "none",
    "given_std": _UNKNOWN,
    "inertia_std": _UNKNOWN,
    "torque_std": _UNKNOWN,
}
"""In place of null in TOML, where that is not "not determined"."""
_HEADING = {"format": 1, "kind": KIND, "side": "motor"}
_FOR_PEOPLE = {*_HEADING, "standard_error", "units", "undetermined"}
"""Keys that hold nothing to read."""
_PRIORS = [field.name for field in fields(PriorRow)]
_GEARS = [field.name for field in fields(Gear)]


def to_document(identification: Identification) -> dict[str, Any]:
    """Return the document that JSON and TOML hold, of plain lists, numbers, texts and None.

    Gears and priors are tables of one list per column; what was not fitted or stated is left out.
    """
    i = identification
    names = np.array(elasticity_labels(i.n))[np.isinf(i.standard_error)].tolist()
    errors = {} if i.delay_error is None else {"standard_error": i.delay_error}
    document: dict[str, Any] = {
        **_HEADING,
        "state": i.state,
        "answer": i.answer,
        "K": i.K,
        "D": i.D,
        "standard_error": i.standard_error,
        "covariance": i.covariance,  # of K1 ... Kn, D1 ... Dn: the total error
        "units": _UNITS,
        "undetermined": dict.fromkeys(names, f"{UNDETERMINED} by these records"),
        "error_parts": i.error_parts,
        "friction": i.friction and vars(i.friction),
        "delay": {} if i.delay is None else {"seconds": i.delay} | errors,
        "effects": {
            name: {"values": values, "standard_error": error}
            for name, (values, error) in i.effects.items()
        },
        "gears": i.gears and _columns(i.gears, [*_GEARS, "kind"]),
        "inertia": inertia_table(i.inertia),  # as fitted together with K and D
        "poses": {name: inertia_table(pose) for name, pose in i.poses.items()},
        "priors": i.priors and _columns(i.priors, [*_PRIORS, "disagreement"]),
        "nominal": i.nominal and vars(i.nominal),
        "obtained": {
            name: value
            for name, value in vars(i.obtained).items()
            if value is not None and (name != "changes" or value)
        },
    }
    there = {
        key: value
        for key, value in document.items()
        if value is not None and (not isinstance(value, dict | tuple) or value)
    }
    finite: dict[str, Any] = with_infinite_as(None, there)
    return finite


def _columns(rows: tuple[Any, ...], names: list[str]) -> dict[str, list[Any]]:
    return {name: [getattr(row, name) for row in rows] for name in names}


def with_infinite_as(word: str | None, value: Any) -> Any:
    """Return a document with ``word`` for None and for numbers that are not finite, arrays as lists."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, dict):
        return {
            key: with_infinite_as(_TOML_WORDS.get(key, word) if word else None, item)
            for key, item in value.items()
        }
    if isinstance(value, list | tuple):
        return [with_infinite_as(word, item) for item in value]
    infinite = value is None or (isinstance(value, float) and not math.isfinite(value))
    return word if infinite else value


def to_json(identification: Identification) -> str:
    """Write an identification as JSON; ``from_json`` returns the same one, bit for bit."""
    return json.dumps(to_document(identification), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def to_toml(identification: Identification) -> str:
    """Write an identification as TOML; ``from_toml`` returns the same one, bit for bit."""
    return tomli_w.dumps(with_infinite_as(UNDETERMINED, to_document(identification)))


def from_json(data: str | bytes, *, where: str = "JSON") -> Identification:
    """Read what ``to_json`` wrote; ``where`` is the name of the file, for messages.

    Raises JointIdError when it is not JSON or not such a document; the message names the fault.
    """
    if len(data) > MAX_TOML_BYTES:
        raise JointIdError(
            f"{where} has more than {MAX_TOML_BYTES} bytes; an identification is far smaller.",
            file=where,
        )
    try:
        values = json.loads(data, parse_constant=_no_constant)
    except RecursionError:
        raise JointIdError(f"{where}: brackets are nested too deeply.", file=where) from None
    except ValueError as error:
        raise JointIdError(f"{where} is not valid JSON: {error!s:.200}.", file=where) from error
    if not isinstance(values, dict):
        raise JointIdError(f"{where} holds {shown(values)}; expected a {KIND}.", file=where)
    return _identification(where, values)


def from_toml(data: str | bytes, *, where: str = "TOML") -> Identification:
    """Read what ``to_toml`` wrote; parameters and errors as in ``from_json``."""
    raw = data.encode("utf-8", "surrogatepass") if isinstance(data, str) else data
    return _identification(where, toml_values(where, raw))


def load_identification(path: str | os.PathLike[str]) -> Identification:
    """Read an identification from a .json or .toml file.

    Raises JointIdError when the file cannot be read, or holds something else.
    """
    file = Path(path)
    read = {".json": from_json, ".toml": from_toml}.get(file.suffix.lower())
    if read is None:
        raise JointIdError(f"{file.name}: expected a file that ends in .json or .toml.", file=file.name)
    try:
        with file.open("rb") as stream:
            data = stream.read(MAX_TOML_BYTES + 1)
    except (OSError, ValueError) as error:
        fault = getattr(error, "strerror", error)
        raise JointIdError(f"{file} cannot be read: {fault}.", file=str(file)) from error
    return read(data, where=file.name)


def _identification(where: str, document: dict[str, Any]) -> Identification:
    """The identification of a document; the constructors of its parts check their values."""
    place = ""
    try:
        for key, value in _HEADING.items():
            if document.get(key) != value:
                raise ValueError(f"{key} = {shown(document.get(key))}; expected {key} = {value!r}.")
        known = {"friction": None, "nominal": None, "poses": {}, "delay": {}} | document
        known = {key: value for key, value in known.items() if key not in _FOR_PEOPLE}
        if unknown := known.keys() - {field.name for field in fields(Identification)}:
            raise ValueError(f'unknown key "{min(unknown):.60}"')
        for place in _READERS.keys() & known.keys():
            if known[place] is not None:
                known[place] = _READERS[place](known[place])
        place, delay = "delay", known["delay"]
        known |= {"delay": delay.get("seconds"), "delay_error": delay.get("standard_error")}
        place = ""
        return Identification(**known)
    except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
        at, fault = f"{where}, {place}" if place else where, f"{error!s:.300}".rstrip(".")
        raise JointIdError(f"{at}: {fault}. Export it again.", file=where) from error


def _numbers(value: Any) -> Any:
    """Numbers of a document at any depth, with infinity for its words."""
    if isinstance(value, dict):
        return {key: _numbers(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_numbers(item) for item in value]
    return math.inf if value in _INFINITE else value


def _deviations(table: dict[str, Any]) -> dict[str, Any]:
    """A table with infinity for the words of its standard deviations and errors."""
    return {k: _numbers(v) if k.endswith(("_std", "_error")) else v for k, v in table.items()}


def _rows(kind: type[T], names: list[str], columns: dict[str, list[Any]]) -> tuple[T, ...]:
    """Dataclasses of columns that are equally long."""
    columns = _deviations({name: columns[name] for name in names if name in columns})
    rows = zip(*columns.values(), strict=True)
    return tuple(typed(kind, dict(zip(columns, row, strict=True))) for row in rows)


_READERS: dict[str, Callable[[Any], Any]] = {
    "covariance": _numbers,
    "error_parts": _numbers,
    "friction": lambda table: Friction(**_deviations(table)),
    "effects": lambda tables: {
        name: (table["values"], _numbers(table["standard_error"]))
        for name, table in tables.items()
        if name in EFFECT_PARAMETERS
    },
    "gears": lambda columns: _rows(Gear, _GEARS, columns),
    "inertia": lambda table: Inertia(**table),
    "poses": lambda tables: {name: Inertia(**table) for name, table in tables.items()},
    "priors": lambda columns: _rows(PriorRow, _PRIORS, columns),
    "nominal": lambda table: Elasticity(**table),
    "obtained": lambda table: typed(Obtained, _deviations(table)),
}
"""Parts of an identification from their tables, by key."""


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is not a number")
