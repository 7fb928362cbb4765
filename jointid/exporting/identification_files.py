"""An identification as JSON or TOML, and back, equal to the last bit.

Both hold the same document, motor side, SI units; ``EXAMPLE`` shows all its keys. Readers ignore
``standard_error``, ``undetermined``, ``units`` and the disagreement of priors, which are for people. An
infinite error, of an undetermined parameter, is null in JSON and "not determined" in TOML; the infinite
standard deviation of an unknown inertia is null and "unknown".
"""

import json
import math
import os
import tomllib
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from jointid.answer import EFFECT_PARAMETERS
from jointid.errors import JointIdError
from jointid.estimation.elasticity import Friction
from jointid.estimation.estimators.parameters import elasticity_labels
from jointid.exporting.identification import Identification, Obtained
from jointid.files.study_keys import INERTIA_KEYS, in_place, read_inertia, read_nominal, read_poses
from jointid.files.study_saving import inertia_table
from jointid.gears.gear import Gear
from jointid.parsing.checked_toml import MAX_TOML_BYTES, CheckedTable, parse_toml
from jointid.uncertainty.prior_rows import PriorRow
from jointid.wording import UNDETERMINED, shown

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
_NONE = "none"
_INFINITE = (None, UNDETERMINED, _UNKNOWN)
"""In place of an infinite number."""
_TOML_WORDS = {
    "disagreement": _NONE,
    "given_std": _UNKNOWN,
    "inertia_std": _UNKNOWN,
    "torque_std": _UNKNOWN,
}
"""In place of null in TOML, where that is not "not determined"."""
EXAMPLE: dict[str, Any] = tomllib.loads("""
format = 1
kind = "jointid identification"
side = "motor"
state = "usable"                  # or "usable with care", "not usable"
answer = "Joint 1 has a stiffness of 43.00 ± 0.02 N·m/rad."
K = [43.0]                        # N·m/rad
D = [0.1]                         # N·m·s/rad
standard_error = [0.02, 0.001]
covariance = [[4e-4, 0.0], [0.0, 1e-6]]     # of K1 ... Kn, D1 ... Dn: the total error
units = {}
undetermined = {}
error_parts = {noise = [0.01, 0.001], prior = [0.0, 0.0], unseen = [0.0, 0.0], choice = [0.0, 0.0]}
friction = {coulomb = [0.05], viscous = [0.002], standard_error = [0.001, 0.0001]}
delay = {seconds = 0.0015, standard_error = 1e-7}
effects.lag = {values = [0.001], standard_error = [0.0001]}
gears = {}                        # fields of Gear, one value per joint
inertia = {M = [0.0025], M2 = [[0.004]]}    # as fitted together with K and D
poses.stretched = {M = [0.0025], M2 = [[0.008]]}
nominal = {K = [20.0], D = [0.1]}

[priors]                          # every inertia and torque scale
name = ["J_m1"]
unit = ["kg·m²"]
given = [0.0025]
given_std = [0.0001]
fitted = [0.0025]
fitted_std = [0.0001]
is_fitted = [true]
disagreement = [0.1]              # in standard deviations of the given value

[obtained]
version = "0.2.0"
digest = "30db4de36afc859322bd330155b95746"
study = "Waterjet cell"
origin = "measured"
method = "auto"
model = "elasticity + friction"
free_reversal = 0.0
records = 36
frequencies_hz = [3.0, 5.0]
misfit = 1.1
inertia_std = 0.05
torque_std = 0.02
changes = ["Left out: 05.csv."]
""")
"""A document with all keys."""
_EFFECT = {"values": "values = […]", "standard_error": "standard_error = […]"}
_GEARS = {field.name: f"{field.name} = […]" for field in fields(Gear)} | {"kind": "kind = […]"}


_SEPARATE = {"effects", "gears", "inertia", "poses", "nominal"}
"""Tables with readers of their own."""
_FOR_PEOPLE = {"kind", "format", "side", "standard_error", "units", "undetermined", "disagreement"}
"""Keys at the top, and the disagreement of priors, that hold nothing to read."""
_FINITE = {"K", "D", "coulomb", "viscous", "frequencies_hz"}
_OPTIONAL = {"state", "answer", "error_parts", "friction", "delay", "priors"}
_OPTIONAL |= {*EXAMPLE["error_parts"], "inertia_std", "torque_std", "changes"}


def _examples(values: dict[str, Any]) -> dict[str, str]:
    """Examples of the keys of a table."""
    return {
        key: f"[{key}]"
        if isinstance(value, dict)
        else f"{key} = {json.dumps(value, ensure_ascii=False)}"
        for key, value in values.items()
    }


def to_document(identification: Identification) -> dict[str, Any]:
    """Return the document that JSON and TOML hold, of plain lists, numbers, texts and None."""
    i = identification
    names = np.array(elasticity_labels(i.n))[np.isinf(i.standard_error)].tolist()
    effects = {name: dict(zip(_EFFECT, pair, strict=True)) for name, pair in i.effects.items()}
    errors = {} if i.delay_error is None else {"standard_error": i.delay_error}
    obtained = {name: getattr(i.obtained, name) for name in EXAMPLE["obtained"]}
    document: dict[str, Any] = {
        "format": 1,
        "kind": KIND,
        "side": "motor",
        "state": i.state,
        "answer": i.answer,
        "K": i.K,
        "D": i.D,
        "standard_error": i.standard_error,
        "covariance": i.covariance,
        "units": _UNITS,
        "undetermined": dict.fromkeys(names, f"{UNDETERMINED} by these records"),
        "error_parts": i.error_parts,
        "friction": i.friction and vars(i.friction),
        "delay": {} if i.delay is None else {"seconds": i.delay} | errors,
        "effects": effects,
        "gears": i.gears and {name: [getattr(gear, name) for gear in i.gears] for name in _GEARS},
        "inertia": inertia_table(i.inertia),
        "poses": {name: inertia_table(pose) for name, pose in i.poses.items()},
        "priors": i.priors
        and {name: [getattr(row, name) for row in i.priors] for name in EXAMPLE["priors"]},
        "nominal": i.nominal and vars(i.nominal),
        "obtained": {
            name: value
            for name, value in obtained.items()
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

    Raises JointIdError when it is not JSON or not such a document; the message names the key.
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
    return _identification(CheckedTable(where, values, _examples(EXAMPLE)))


def from_toml(data: str | bytes, *, where: str = "TOML") -> Identification:
    """Read what ``to_toml`` wrote; parameters and errors as in ``from_json``."""
    raw = data.encode("utf-8", "surrogatepass") if isinstance(data, str) else data
    return _identification(parse_toml(where, raw, _examples(EXAMPLE)))


def load_identification(path: str | os.PathLike[str]) -> Identification:
    """Read an identification from a .json or .toml file.

    Raises JointIdError when the file cannot be read, or holds something else.
    """
    file = Path(path)
    if file.suffix.lower() not in (".json", ".toml"):
        raise JointIdError(f"{file.name}: expected a file that ends in .json or .toml.", file=file.name)
    try:
        with file.open("rb") as stream:
            data = stream.read(MAX_TOML_BYTES + 1)
    except (OSError, ValueError) as error:
        fault = getattr(error, "strerror", error)
        raise JointIdError(f"{file} cannot be read: {fault}.", file=str(file)) from error
    read = from_json if file.suffix.lower() == ".json" else from_toml
    return read(data, where=file.name)


def _identification(top: CheckedTable) -> Identification:
    kind = top.text("kind", "")
    if kind != KIND:
        raise top.error(f'kind = "{kind:.60}"; expected kind = "{KIND}".')
    if (number := top.integer("format")) != 1:
        raise top.error(f"format = {shown(number)}, but this version reads format 1.")
    if (side := top.text("side", "motor")) != "motor":
        raise top.error(f'side = "{side:.60}"; expected side = "motor".')
    known = _values(top, EXAMPLE)
    if "friction" in known:
        known["friction"] = Friction(**known["friction"])  # checked by Identification
    delay = known.pop("delay", {})
    known |= {"delay": delay.get("seconds"), "delay_error": delay.get("standard_error")}
    known["inertia"] = read_inertia(top.table("inertia", INERTIA_KEYS))
    known |= {"poses": read_poses(top), "nominal": read_nominal(top)}
    known["effects"] = {
        name: (table.numbers("values"), table.numbers("standard_error", words=_INFINITE))
        for name, table in top.named_tables("effects", _EFFECT).items()
        if name in EFFECT_PARAMETERS
    }
    if "gears" in top:
        table = top.table("gears", _GEARS)
        columns = {name: table.numbers(name) for name in _GEARS if name in table and name != "kind"}
        rows = zip(*columns.values(), strict=False)
        known["gears"] = tuple(Gear(**dict(zip(columns, row, strict=True))) for row in rows)
    if "priors" in known:
        try:
            rows = zip(*known["priors"].values(), strict=True)
            known["priors"] = tuple(PriorRow(*row) for row in rows)
        except ValueError:
            raise top.error("[priors]: all lists must have the same length.") from None
    how = known["obtained"]
    how |= {name: tuple(how[name]) for name in ("frequencies_hz", "changes") if name in how}
    with in_place(top.where, top.file):
        return Identification(**{"friction": None} | known | {"obtained": Obtained(**how)})


def _values(table: CheckedTable, example: dict[str, Any]) -> dict[str, Any]:
    """Values of a table, each of the kind that its example has."""
    found: dict[str, Any] = {}
    skipped = _SEPARATE | _FOR_PEOPLE if example is EXAMPLE else {"disagreement"}
    optional = _OPTIONAL | ({"standard_error"} if example is EXAMPLE["delay"] else set())
    for key, value in example.items():
        if key in skipped or (key not in table and key in optional):
            continue
        kind = value[0] if isinstance(value, list) else value
        words = () if key in _FINITE else _INFINITE
        if isinstance(value, dict):
            found[key] = _values(table.table(key, _examples(value)), value)
        elif isinstance(kind, list):
            found[key] = table.matrix(key, words=words)
        elif isinstance(value, list):
            read: Any = {str: table.texts, bool: table.flags}.get(type(kind))
            found[key] = read(key) if read else table.numbers(key, words=words)
        elif key in ("inertia_std", "torque_std"):
            found[key] = table.deviation(key, words=words)
        else:
            read = {str: table.text, int: table.integer}.get(type(value), table.number)
            found[key] = read(key)
    return found


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is not a number")
