"""The JSON Schema of study.toml describes what the reader reads."""

from __future__ import annotations

import json
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from jointid.files import study_keys

ROOT = Path(__file__).parents[1]
SCHEMA: dict[str, Any] = json.loads((ROOT / "docs/reference/study.schema.json").read_text("utf-8"))
SAMPLES = sorted((ROOT / "sample_data").glob("*.zip"))
VALIDATOR = Draft202012Validator(SCHEMA)


def keys(*path: str) -> set[str]:
    table = SCHEMA
    for step in path:
        table = table[step]
    return set(table["properties"])


def test_is_a_schema() -> None:
    Draft202012Validator.check_schema(SCHEMA)


def test_has_the_keys_of_the_reader() -> None:
    assert keys() == set(study_keys.STUDY_KEYS)
    assert keys("properties", "torque") == set(study_keys.TORQUE_KEYS)
    assert keys("properties", "nominal") == set(study_keys.NOMINAL_KEYS)
    assert keys("properties", "timing") == set(study_keys.TIMING_KEYS)
    assert keys("properties", "robot_model") == set(study_keys.ROBOT_KEYS)
    assert keys("properties", "robot_model", "properties", "payload") == set(study_keys.PAYLOAD_KEYS)
    assert keys("$defs", "inertia") == set(study_keys.INERTIA_KEYS)
    assert keys("$defs", "pose") == set(study_keys.POSE_KEYS)
    assert keys("$defs", "record") == set(study_keys.RECORD_KEYS)


@pytest.mark.parametrize("sample", SAMPLES, ids=lambda path: path.stem)
def test_samples_are_valid(sample: Path) -> None:
    with zipfile.ZipFile(sample) as archive:
        VALIDATOR.validate(tomllib.loads(archive.read("study.toml").decode()))


@pytest.mark.parametrize(
    "change",
    [{"inertia": {"M": [1.0]}}, {"records": []}, {"record": 1}, {"records": [{"file": "a.xlsx"}]}],
)
def test_refuses_what_the_reader_refuses(change: dict[str, Any]) -> None:
    study = {"format": 1, "inertia": {"M": [1.0], "M2": [[1.0]]}, "records": [{"file": "a.csv"}]}
    assert VALIDATOR.is_valid(study)
    assert not VALIDATOR.is_valid(study | change)
