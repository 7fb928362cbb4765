"""The JSON Schema of study.toml agrees with its reader."""

from __future__ import annotations

import json
import re
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from jointid import load_study
from jointid.files import study_keys
from jointid.setpoints.robot_limits import LIMIT_KEYS, limits_from_toml

ROOT = Path(__file__).parents[1]
SCHEMA: dict[str, Any] = json.loads((ROOT / "docs/reference/study.schema.json").read_text("utf-8"))
SAMPLES = sorted((ROOT / "sample_data").glob("*.zip"))
VALIDATOR = Draft202012Validator(SCHEMA)
LEAST = {"format": 1, "inertia": {"M": [1.0], "M2": [[1.0]]}, "records": [{"file": "a.csv"}]}


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text("utf-8"), re.MULTILINE | re.DOTALL)


TOML = [page for page in sorted((ROOT / "docs").rglob("*.md")) if blocks(page, "toml")]


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
    assert VALIDATOR.is_valid(LEAST)
    assert not VALIDATOR.is_valid(LEAST | change)


@pytest.mark.parametrize("page", TOML, ids=lambda path: path.stem)
def test_toml_in_the_documents_is_valid(page: Path) -> None:
    for text in blocks(page, "toml"):
        table = tomllib.loads(text)
        if set(table) <= set(LIMIT_KEYS):
            limits_from_toml(text.encode(), page.name)
        else:
            VALIDATOR.validate(LEAST | table)


def test_the_study_of_the_reference_is_read(tmp_path: Path) -> None:
    page = ROOT / "docs/reference/study-format.md"
    (toml, _), (csv,) = blocks(page, "toml"), blocks(page, "csv")  # the second is of a robot model
    (tmp_path / "records").mkdir()
    (tmp_path / "study.toml").write_text(toml, "utf-8")
    header, *rows = csv.splitlines()
    time = 0.00025 * np.arange(len(rows), 12000)
    rows += [f"{t:.5f},{np.sin(6 * np.pi * t)},0,1,0.5" for t in time]
    (tmp_path / "records/01.csv").write_text("\n".join([header, *rows]), "utf-8")
    study = load_study(tmp_path)
    assert study.records[0].theta_rad[0, 0] == 0.01203
    assert set(study.poses) == {"stretched", "loaded"}
