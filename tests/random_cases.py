"""How many random cases tests try: with ``--nightly`` all, with ``--long`` 40 %, else a tenth."""

from __future__ import annotations

from typing import Any, TypeVar

from hypothesis import settings

T = TypeVar("T")
ALL = 100
"""Examples of a test that names no number."""
OF_RUN = {"normal": 10, "long": 40, "nightly": ALL}
"""How many of them each kind of run tries, from the shortest kind to the longest."""
FEWEST = 10


def begin(run: str) -> None:
    """Choose the number of examples, before tests are read.

    A busy machine is no fault: how long an example takes is not what the tests are about.
    """
    settings.register_profile("jointid", max_examples=OF_RUN[run], deadline=None)
    settings.load_profile("jointid")


def share(count: int) -> int:
    """How many of so many tries this run makes."""
    return max(count * settings().max_examples // ALL, min(count, FEWEST))


def tries(count: T, **more: T) -> T:
    """How many tries this run makes of costly cases, or which of them.

    ``long=`` and ``nightly=`` are those of longer runs, each by default as many as in the run before it.
    """
    for run, examples in OF_RUN.items():
        if examples <= settings().max_examples:
            count = more.get(run, count)
    return count


def examples(count: int, **more: Any) -> settings:
    """Settings of a test that tries so many examples at night."""
    return settings(max_examples=share(count), **more)
