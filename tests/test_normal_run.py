"""The tables of variants of normal and nightly runs name tests and variants that exist."""

from __future__ import annotations

from collections import defaultdict
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path

import pytest
from normal_run import COLLECTED, NIGHTLY, VARIANTS


def test_every_entry_names_a_test_and_its_patterns_variants(request: pytest.FixtureRequest) -> None:
    """Patterns, of the tests that were read here."""
    text = cache(lambda path: path.read_text("utf-8"))
    variants = defaultdict[tuple[str, str], list[str]](list)
    for file, test, variant in request.config.stash[COLLECTED]:
        variants[file, test].append(variant)
    for entry, patterns in (*VARIANTS.items(), *NIGHTLY.items()):
        file, _, test = (f"test_{part}" for part in entry.partition("::"))
        path = Path(__file__).with_name(f"{file}.py")
        assert f"def {test}(" in text(path), entry
        of_test = variants[path.name, test]
        unused = [p for p in patterns if not any(fnmatchcase(v, p) for v in of_test)]
        assert not (of_test and unused), f"{entry}: {unused}"
