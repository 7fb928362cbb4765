"""Background computations: bit-identical in a worker process; without one, in this process in turn."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import fields, is_dataclass
from functools import partial
from pathlib import Path
from threading import Event, Lock
from time import monotonic, sleep
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

from jointid import JointIdError, Study, analyse, load_study
from jointid.analysis import reanalysed
from jointid.background.child_process import Child
from jointid.background.pool import NoWorkerError, Pool, Stop, StoppedError
from jointid.ui.shared import results
from jointid.ui.shared.page import analyse_first_sample
from jointid.ui.shared.results import ResultCache, result_cache, run_in_background, run_watched
from jointid.ui.shared.settings import DEFAULT_METHOD
from jointid.ui.shared.workspace import open_sample, sample_paths
from jointid.uncertainty.resampling import jackknife

SAMPLE = Path(__file__).parents[1] / "sample_data" / "single_joint"
PATIENCE_S = 30.0


@pytest.fixture(scope="module")
def study() -> Study:
    return load_study(SAMPLE)


def answers(pool: Pool) -> int:
    """Which process answers, as soon as there is one."""
    end = monotonic() + PATIENCE_S
    while True:
        pool.start()
        until(lambda: bool(pool._idle))
        try:
            return int(pool.call(os.getpid))
        except NoWorkerError:  # the idle one was dead; another is being started
            assert monotonic() < end


def until(condition: Callable[[], bool]) -> None:
    """Wait for something to be so."""
    end = monotonic() + PATIENCE_S
    while not condition():
        assert monotonic() < end
        sleep(0.01)


def end(pool: Pool) -> None:
    """End the processes of a pool, including one that is starting; the server's end with the server."""
    until(lambda: len(pool._idle) == pool._started)
    for child in pool._idle:
        child.stop()


@pytest.fixture(scope="module")
def ready() -> Iterator[Pool]:
    """A pool with one ready process."""
    pool = Pool(1)
    assert answers(pool) != os.getpid()
    yield pool
    end(pool)


@pytest.fixture
def pool(monkeypatch: pytest.MonkeyPatch) -> Iterator[Pool]:
    """The pages' pool, without processes and with a free turn."""
    mine = Pool(1)
    monkeypatch.setattr(results, "_pool", lambda: mine)
    yield mine
    end(mine)


def differences(one: Any, other: Any, where: str = "") -> list[str]:
    """Where two values differ in a bit, in kind, or in being read-only."""
    if type(one) is not type(other):
        return [f"{where}: {type(one)} and {type(other)}"]
    if isinstance(one, np.ndarray):
        same = one.tobytes() == other.tobytes() and one.dtype == other.dtype
        return [] if same and one.flags.writeable == other.flags.writeable else [where]
    if is_dataclass(one):
        parts = [(f.name, getattr(one, f.name), getattr(other, f.name)) for f in fields(one)]
    elif isinstance(one, dict | MappingProxyType):
        assert list(one) == list(other), where
        parts = [(str(key), one[key], other[key]) for key in one]
    elif isinstance(one, tuple | list):
        assert len(one) == len(other), where
        parts = [(str(k), a, b) for k, (a, b) in enumerate(zip(one, other, strict=True))]
    else:
        return [] if one == other or (one != one and other != other) else [f"{where}: {one} {other}"]
    return [found for name, a, b in parts for found in differences(a, b, f"{where}.{name}")]


def test_an_analysis_from_another_process_is_identical(ready: Pool, study: Study) -> None:
    found = ready.call(partial(analyse, method="auto"), study)
    assert found.study is study, "what was given comes back as itself"
    assert differences(found, analyse(study)) == []
    with pytest.raises(TypeError):
        found.fits["auto"] = None


def test_errors_and_progress_are_returned_from_the_process(ready: Pool, study: Study) -> None:
    with pytest.raises(JointIdError, match="needs a Study"):
        ready.call(analyse, "no study")
    with pytest.raises(TypeError, match="returned lock, which cannot be sent"):
        ready.call(Lock)
    analysis, seen = analyse(study), list[float]()
    given = (analysis.phasors, study.inertias, analysis.fit)
    found = ready.call(jackknife, *given, progress=seen.append)
    assert differences(found, jackknife(*given)) == []
    assert seen == sorted(seen)
    assert seen[-1] == 1


def test_a_cancelled_call_returns_immediately(ready: Pool, study: Study) -> None:
    class ClickedError(BaseException):
        """As the pages' own way to end a script."""

    def click(_: float) -> None:
        raise ClickedError

    analysis = analyse(study)
    with pytest.raises(ClickedError):
        ready.call(jackknife, analysis.phasors, study.inertias, analysis.fit, progress=click)
    assert answers(ready)


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_a_killed_process_is_replaced(ready: Pool) -> None:
    before = answers(ready)
    os.kill(before, signal.SIGKILL)
    assert answers(ready) != before


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_a_call_that_ends_its_process_twice_is_an_error(ready: Pool) -> None:
    with pytest.raises(JointIdError, match="SIGABRT"):
        ready.call(os.abort)
    assert answers(ready)


def test_without_processes_the_call_runs_in_this_process(pool: Pool) -> None:
    with pytest.raises(NoWorkerError):
        pool.call(len, "abc")
    assert run_in_background(os.getpid) == os.getpid()


@pytest.mark.parametrize(
    "fault",
    [JointIdError("no memory"), pytest.param(OSError(24, "too many files"), marks=pytest.mark.long)],
)
def test_after_a_failed_start_calls_run_in_this_process_for_a_while(
    pool: Pool, monkeypatch: pytest.MonkeyPatch, fault: Exception
) -> None:
    def fails(_: Child) -> None:
        raise fault

    with monkeypatch.context() as broken:
        broken.setattr(Child, "start", fails)
        pool.start()
        until(lambda: not pool._started)
    pool.start()
    assert not pool._started, "not at once again"
    assert run_in_background(os.getpid) == os.getpid()
    monkeypatch.setattr(pool, "_retry_after_s", 0.0)
    assert answers(pool) != os.getpid()


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_a_call_whose_process_is_killed_is_repeated_in_another(pool: Pool) -> None:
    first, stop = answers(pool), Stop()
    with ThreadPoolExecutor(1) as threads:
        call = threads.submit(partial(pool.call, sleep, 1.0, stop=stop))
        until(lambda: stop.child is not None)  # of a process killed before, there is none to repeat in
        os.kill(first, signal.SIGKILL)
        assert call.result(PATIENCE_S) is None
    assert answers(pool) != first


def test_a_stopped_call_ends_its_process_and_not_the_next_call(ready: Pool) -> None:
    stop = Stop()
    with ThreadPoolExecutor(1) as threads:
        call = threads.submit(partial(ready.call, sleep, PATIENCE_S, stop=stop))
        until(lambda: stop.child is not None)
        stop.set()
        with pytest.raises(StoppedError):
            call.result(PATIENCE_S)
    assert answers(ready)
    with pytest.raises(StoppedError):
        ready.call(os.getpid, stop=stop)


@pytest.fixture
def held() -> Iterator[tuple[Callable[[], str], Event, Event]]:
    """A computation that says when it began, and ends when it is told to."""
    began, end = Event(), Event()

    def long() -> str:
        began.set()
        assert end.wait(PATIENCE_S)
        return "long"

    yield long, began, end
    end.set()


def test_processes_start_with_the_first_page(
    pool: Pool, held: tuple[Callable[[], str], Event, Event], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not at once, which would delay its picture."""
    monkeypatch.setattr(results, "_LONGEST_TURN_S", 0.01)
    monkeypatch.setattr(results, "_UNDISTURBED_S", 0.2)
    long, began, end = held
    with ThreadPoolExecutor(1) as threads:
        first = threads.submit(run_in_background, long)
        assert began.wait(PATIENCE_S)
        assert run_in_background(os.getpid) == os.getpid(), "a long turn holds nobody up for good"
        assert not pool._started, "what the server prepares must not wait for them"
        monkeypatch.setattr(results, "_session", lambda: "one")
        assert run_in_background(os.getpid) == os.getpid()
        assert not pool._started
        until(lambda: pool.is_ready)
        assert answers(pool) == run_in_background(os.getpid) != os.getpid()
        assert not first.done()
        end.set()
        assert first.result(PATIENCE_S) == "long"


@pytest.mark.parametrize("has_turn", [False, True])
def test_with_processes_nothing_runs_here(
    pool: Pool, monkeypatch: pytest.MonkeyPatch, has_turn: bool
) -> None:
    """Otherwise queued calls would run in this process and slow every page."""
    monkeypatch.setattr(results, "_LONGEST_TURN_S", 0.01)
    with ThreadPoolExecutor(1) as threads, nullcontext() if has_turn else results._turn:
        worker = answers(pool)
        busy = threads.submit(pool.call, sleep, 0.4)
        until(lambda: not pool._idle)
        assert run_in_background(os.getpid) == worker, "it waits for the process"
        busy.result(PATIENCE_S)


def test_calls_wait_in_order_and_a_stopped_one_leaves_the_queue(ready: Pool) -> None:
    answers(ready)
    with ThreadPoolExecutor(6) as threads:
        busy = threads.submit(ready.call, sleep, 1.0)
        until(lambda: not ready._idle)
        stops, asked = [Stop() for _ in range(5)], []
        for stop in stops:
            asked.append(threads.submit(partial(ready.call, monotonic, stop=stop)))
            until(lambda: len(ready._waiting) == len(asked))
        stops[2].set()
        with pytest.raises(StoppedError):
            asked[2].result(PATIENCE_S)
        assert not busy.done(), "it need not wait for its turn"
        served = [call.result(PATIENCE_S) for k, call in enumerate(asked) if k != 2]
    assert served == sorted(served)


def test_a_queued_call_waits_for_a_process_that_is_starting(ready: Pool) -> None:
    """The only one ends, while another is starting: the next call needs no process here."""
    answers(ready)
    stop = Stop()
    with ThreadPoolExecutor(2) as threads:
        busy = threads.submit(partial(ready.call, sleep, PATIENCE_S, stop=stop))
        until(lambda: stop.child is not None)
        queued = threads.submit(ready.call, os.getpid)
        until(lambda: len(ready._waiting) == 1)
        stop.set()
        with pytest.raises(StoppedError):
            busy.result(PATIENCE_S)
        assert queued.result(PATIENCE_S) != os.getpid()


def test_the_lock_is_released_after_an_error(pool: Pool) -> None:
    def fails() -> None:
        raise ValueError("no")

    for _ in range(3):
        with pytest.raises(ValueError, match="no"):
            run_in_background(fails)
    assert results._turn.acquire(blocking=False)
    results._turn.release()


def test_equal_computations_share_a_result_and_failures_are_not_cached(pool: Pool) -> None:
    kept, calls = ResultCache(most_bytes=0, always_kept=2), list[int]()

    def fails() -> None:
        calls.append(1)
        raise ValueError("no")

    def counts() -> int:
        calls.append(2)
        return len(calls)

    for _ in range(2):
        with pytest.raises(ValueError, match="no"):
            kept.begin("a", fails).result(PATIENCE_S)
    assert calls == [1, 1]
    assert [kept.begin("b", counts).result(PATIENCE_S) for _ in range(2)] == [3, 3]
    assert kept.begin("c", counts).result(PATIENCE_S) == 4
    assert kept.begin("b", counts).result(PATIENCE_S) == 3
    assert kept.begin("d", counts).result(PATIENCE_S) == 5
    assert kept.begin("b", counts).result(PATIENCE_S) == 3, "what was asked for last stays longest"
    assert kept.begin("c", counts).result(PATIENCE_S) == 6


def test_the_cache_drops_the_oldest_results_beyond_its_limit() -> None:
    kept = ResultCache(most_bytes=7 << 19, always_kept=1)
    for key in range(5):
        kept.put(key, np.zeros(1 << 17))  # 1 MiB
    assert [key for key in range(5) if kept.get(key) is not None] == [2, 3, 4]
    kept.put("large", np.zeros(1 << 20))
    assert kept.get("large") is not None
    assert kept.get(4) is None


def test_a_queue_is_shown_when_all_processors_are_busy(
    pool: Pool, held: tuple[Callable[[], str], Event, Event], monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []

    def spinner(text: str, *, show_time: bool) -> AbstractContextManager[None]:
        assert show_time  # a long analysis has no other progress
        said.append(text)
        end.set()
        return nullcontext()

    monkeypatch.setattr(results.st, "spinner", spinner)
    long, began, end = held
    waiting = [object() for _ in range(results._PROCESSES + 2)]
    results._asked.update(waiting)
    try:
        begun = results.submit(long)
        assert began.wait(PATIENCE_S)
        results.awaited("Computing", begun)
    finally:
        results._asked.difference_update(waiting)
    assert begun.result() == "long"
    assert said == ["Computing. The server is busy: 3 computations in the queue."]
    results.awaited("Computing", begun)
    assert len(said) == 1, "a finished computation shows nothing"
    assert results.queue_text() == ""


def test_a_click_ends_a_watched_computation(ready: Pool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(results, "_pool", lambda: ready)
    answers(ready)

    def clicked() -> None:
        raise InterruptedError

    with pytest.raises(InterruptedError):
        run_watched(clicked, sleep, PATIENCE_S)
    until(lambda: not ready._ready)
    assert answers(ready)
    assert run_watched(bool, abs, -1) == 1


def test_the_first_sample_is_analysed_for_its_page(pool: Pool) -> None:
    analyse_first_sample()
    name = next(iter(sample_paths()))
    assert result_cache().get(("analysis", open_sample(name).digest, DEFAULT_METHOD)) is not None


def test_another_estimator_uses_the_known_analysis(ready: Pool, study: Study) -> None:
    """It differs in no bit from a whole analysis, and comes back without what was sent."""
    known = analyse(study)
    found = ready.call(reanalysed, study, known, "explicit")
    assert differences(found, analyse(study, method="explicit")) == []
    assert found.phasors is known.phasors
    assert found.fit is known.fits["explicit"]
