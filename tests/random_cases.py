"""How many random cases tests try: with ``--long`` all, else a tenth."""

from __future__ import annotations

from typing import Any, TypeVar

from hypothesis import settings

T = TypeVar("T")
ALL, NORMAL = 100, 10
"""Examples of a test that names no number."""
FEWEST = 10


def begin(*, long: bool) -> None:
    """Choose the number of examples, before tests are read.

    A busy machine is no fault: how long an example takes is not what the tests are about.
    """
    settings.register_profile("jointid", max_examples=ALL if long else NORMAL, deadline=None)
    settings.load_profile("jointid")


def share(count: int) -> int:
    """How many of so many tries this run makes."""
    return max(count * settings().max_examples // ALL, min(count, FEWEST))


def tries(count: T, *, long: T) -> T:
    """How many tries this run makes of costly cases, or which of them."""
    return long if settings().max_examples == ALL else count


def examples(count: int, **more: Any) -> settings:
    """Settings of a test that tries so many examples in a long run."""
    return settings(max_examples=share(count), **more)
