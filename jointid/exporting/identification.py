"""K and D with their covariance, model, inertias and origin: one document, as JSON or TOML.

Motor side, of sensors behind the gears joint side; SI units. Python's ``json`` and ``tomllib`` return
every number to the last bit. An infinite error, of an undetermined parameter, is null in JSON and "not
determined" in TOML; the infinite standard deviation of an unknown inertia is null and "unknown".
"""

import json
import math
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np
import tomli_w

from jointid.analysis import Analysis, Answer, ArmSideAnalysis
from jointid.answer import STIFFNESS_UNITS, model_name
from jointid.estimation.estimators.parameters import EFFECT_PARAMETERS, PARAMETERS, elasticity_labels
from jointid.files.application import __version__
from jointid.files.digest import study_digest
from jointid.files.study_saving import inertia_table
from jointid.gears.gear import Gear
from jointid.uncertainty.answer_tables import PriorRow, error_parts
from jointid.wording import UNDETERMINED, counted

_UNITS = {
    ("inertia" if kind == "M" else kind): PARAMETERS[kind].unit
    for kind in ("K", "D", "M", "coulomb", "viscous", "delay")
}
_OTHERS = {"Sensors behind the gears": "arm_side", "Motors": "motors"}
_LAW = [field.name for field in fields(Gear)]
_TOML_WORDS = {"disagreement": "none"} | dict.fromkeys(
    ("given_std", "inertia_std", "torque_std"), "unknown"
)
"""In place of null in TOML, where that is not "not determined"."""


def stored(analysis: Answer) -> Answer:
    """Return an answer in the unit of files: N·m/rad; that of arm-side sensors stays at the joint."""
    return analysis.shown_in(next(iter(STIFFNESS_UNITS)))


def answer_text(analysis: Answer) -> str:
    """Return the answer, in the unit of files, with its limits; if not usable, the reason."""
    headline = stored(analysis).headline
    return " ".join(text for text in (headline, analysis.caution, *analysis.study.remarks) if text)


def warning_text(analysis: Answer, values: str) -> str:
    """Return on one line the reason why an answer is not usable, and the consequence for its values."""
    state, _, reason = " ".join(answer_text(analysis).split()).partition(":")
    return f"{state.upper()}:{reason} {values}"


def origin_text(analysis: Answer) -> str:
    """Return software, study, estimator, model and number of records on one line."""
    fit, study = analysis.fit, analysis.study
    made = f"jointid {__version__}; study {study_digest(study)}; estimator {fit.method}"
    return f"{made}; model: {model_name(fit)}; {counted(len(study.records), 'record')}"


def to_document(analysis: Answer) -> dict[str, Any]:
    """Return the document that JSON and TOML hold, of plain lists, numbers, texts and None.

    Gears and priors are tables of one list per column; what was not fitted or stated is left out.
    "arm_side" is the answer of sensors behind the gears in addition to that of the motors, "motors" that
    of the motors in addition to that of the sensors.
    """
    study = analysis.study
    document = {
        "format": 1,
        "kind": "jointid identification",
        **_results(analysis),
        **{_OTHERS[name]: _results(other) for name, other in [*analysis.each.items()][1:]},
    }
    document["obtained"] = _stated(
        {
            "version": __version__,
            "digest": study_digest(study),
            "study": study.name,
            "origin": study.origin,
            "method": analysis.fit.method,
            "model": model_name(analysis.fit),
            "records": len(study.records),
            **document.pop("obtained", {}),
            "changes": study.changes or None,
        }
    )
    there = {
        key: value
        for key, value in _stated(document).items()
        if isinstance(value, np.ndarray) or value not in ({}, ())
    }
    finite: dict[str, Any] = with_infinite_as(None, there)
    return finite


def _results(analysis: Answer) -> dict[str, Any]:
    is_motor = isinstance(analysis, Analysis)
    head = {"side": "motor" if is_motor else "joint", "state": analysis.state}
    of = _of_motors(analysis) if isinstance(analysis, Analysis) else _of_sensors(analysis)
    return head | {"answer": answer_text(analysis)} | of


def _of_sensors(analysis: Answer) -> dict[str, Any]:
    """K at the joint, with the other results of the fit; NaN where it is refused, with the reasons."""
    assert isinstance(analysis, ArmSideAnalysis)
    fit, nominal = analysis.fit, stored(analysis).nominal
    names = "K", "standard_error", "skew_s", "skew_error_s", "residual_rad", "reasons"
    return _stated(
        {name: getattr(fit, name) for name in names}
        | {
            "left_out_rad": analysis.left_out_rad,
            "units": {"K": _UNITS["K"]},
            "undetermined": {f"K{j}": text for j, text in enumerate(fit.reasons, start=1) if text},
            "nominal": None if nominal is None else {"K": nominal[: fit.K.size]},
        }
    )


def _of_motors(analysis: Analysis) -> dict[str, Any]:
    fit, study = analysis.fit, analysis.study
    known = np.isfinite(fit.standard_error)
    names = np.array(elasticity_labels(fit.n))[~known].tolist()
    delay = {"seconds": fit.delay, "standard_error": fit.delay_error}
    return {
        "K": fit.K,
        "D": fit.D,
        "standard_error": fit.standard_error,
        # Of K1 ... Kn, D1 ... Dn: the total error. Undetermined ones are uncorrelated.
        "covariance": np.where(
            np.outer(known, known), fit.covariance, np.diag(np.where(known, 0, np.inf))
        ),
        "units": _UNITS,
        "undetermined": dict.fromkeys(names, f"{UNDETERMINED} by these records"),
        "error_parts": error_parts(fit),
        "friction": fit.friction and vars(fit.friction),
        "delay": _stated(delay),
        "effects": {
            name: {"values": fit.parameters[name], "standard_error": fit.errors[name]}
            for name in EFFECT_PARAMETERS
            if name in fit.parameters.layout
        },
        "gears": fit.gears and _columns(fit.gears, [*_LAW, "kind", "secant_K"]),
        "inertia": inertia_table(analysis.inertia()),  # as fitted together with K and D
        "poses": {pose: inertia_table(analysis.inertia(pose)) for pose in study.poses},
        "priors": _columns(analysis.priors, [*(f.name for f in fields(PriorRow)), "disagreement"]),
        "nominal": study.nominal and vars(study.nominal),
        "obtained": {
            "free_reversal": next((c.model.reversal for c in fit.candidates if c.chosen), None) or 0.0,
            "frequencies_hz": sorted({record.frequency_hz for record in study.sine_records}),
            "misfit": fit.misfit,
            "inertia_std": study.inertia_std,
            "torque_std": study.torque_std,
        },
    }


def _stated(table: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in table.items() if value is not None}


def _columns(rows: Sequence[Any], names: Sequence[str]) -> dict[str, list[Any]]:
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


def to_json(analysis: Answer) -> str:
    """Write the document of an analysis as JSON."""
    return json.dumps(to_document(analysis), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def to_toml(analysis: Answer) -> str:
    """Write the document of an analysis as TOML."""
    return tomli_w.dumps(with_infinite_as(UNDETERMINED, to_document(analysis)))
