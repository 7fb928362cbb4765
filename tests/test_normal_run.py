"""The table of variants of a normal run names tests and variants that exist."""

from __future__ import annotations

from fnmatch import fnmatchcase
from pathlib import Path

import pytest
from normal_run import COLLECTED, VARIANTS


def test_every_entry_names_a_test() -> None:
    for file, tests in VARIANTS.items():
        text = (Path(__file__).parent / file).read_text("utf-8")
        assert not [test for test in tests if f"def {test}(" not in text], file


def test_every_pattern_names_a_variant(request: pytest.FixtureRequest) -> None:
    """Of the tests that were read here."""
    for file, tests in VARIANTS.items():
        for test, patterns in tests.items():
            of_test = [v for f, name, v in request.config.stash[COLLECTED] if (f, name) == (file, test)]
            unused = [p for p in patterns if not any(fnmatchcase(v, p) for v in of_test)]
            assert not (of_test and unused), f"{file}::{test}: {unused}"
