"""Computations of several sessions at once take turns, and no long one locks the others out."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from threading import Event

import pytest

from jointid.ui import cached

PATIENCE_S = 20.0


@pytest.fixture
def held() -> tuple[Callable[[], str], Event, Event]:
    """A computation that says when it began, and ends when it is told to."""
    began, end = Event(), Event()

    @cached.in_turn
    def long() -> str:
        began.set()
        assert end.wait(PATIENCE_S)
        return "long"

    return long, began, end


def test_the_second_computation_waits_for_the_first(
    held: tuple[Callable[[], str], Event, Event], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cached, "_LONGEST_WAIT_S", PATIENCE_S)
    long, began, end = held
    with ThreadPoolExecutor(2) as threads:
        first = threads.submit(long)
        assert began.wait(PATIENCE_S)
        second = threads.submit(cached.in_turn(end.is_set))
        assert not second.done()
        end.set()
        assert first.result(PATIENCE_S) == "long"
        assert second.result(PATIENCE_S), "it began before the first one was told to end"


def test_a_long_one_holds_nobody_up_for_good(
    held: tuple[Callable[[], str], Event, Event], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cached, "_LONGEST_WAIT_S", 0.01)
    long, began, end = held
    with ThreadPoolExecutor(2) as threads:
        first = threads.submit(long)
        assert began.wait(PATIENCE_S)
        assert threads.submit(cached.in_turn(lambda: 7)).result(PATIENCE_S) == 7
        assert not first.done()
        end.set()
        assert first.result(PATIENCE_S) == "long"


def test_the_turn_is_free_again_after_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cached, "_LONGEST_WAIT_S", 0.01)

    @cached.in_turn
    def fails() -> None:
        raise ValueError("no")

    for _ in range(3):
        with pytest.raises(ValueError, match="no"):
            fails()
    assert cached._turn.acquire(timeout=0)
    cached._turn.release()
