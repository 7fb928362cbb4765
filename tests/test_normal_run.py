"""The table of variants of a normal run names tests and variants that exist."""

from __future__ import annotations

from fnmatch import fnmatchcase
from pathlib import Path

import pytest
from normal_run import VARIANTS


def test_every_entry_names_a_test() -> None:
    for file, tests in VARIANTS.items():
        text = (Path(__file__).parent / file).read_text("utf-8")
        assert not [test for test in tests if f"def {test}(" not in text], file


def test_every_pattern_names_a_variant(request: pytest.FixtureRequest) -> None:
    """Of the tests that were collected here; a normal run then has each of them at least once."""
    tried = {(i.path.name, *i.name.partition("[")[::2]) for i in request.session.items}
    for file, tests in VARIANTS.items():
        for test, patterns in tests.items():
            variants = [v.removesuffix("]") for f, name, v in tried if (f, name) == (file, test)]
            unused = [p for p in patterns if not any(fnmatchcase(v, p) for v in variants)]
            assert not (variants and unused), f"{file}::{test}: {unused}"
