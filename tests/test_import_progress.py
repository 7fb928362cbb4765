"""Long tasks of the import: progress, time left, stop and resume."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
from streamlit.testing.v1 import AppTest
from test_import_page import runs, shown

from jointid import JointIdError
from jointid.importing import MappedLog, find_segments
from jointid.ui.importing import watched_work as importing_work
from jointid.ui.importing.watched_work import Job, Progress, StoppedError
from jointid.ui.shared.results import result_cache


def script() -> None:
    import streamlit as st

    from jointid import JointIdError
    from jointid.ui.importing.watched_work import StoppedError, Watch

    tasks = st.session_state["tasks"]
    watch = Watch(len(tasks), st.empty())
    for key, task in tasks.items():
        try:
            st.write(f"{key}: {watch.do(key, f'Doing {key}', task)}")
        except StoppedError:
            break
        except JointIdError as error:
            st.error(str(error))


@pytest.fixture
def page() -> AppTest:
    result_cache.clear()
    return AppTest.from_function(script, default_timeout=30)


def texts(at: AppTest) -> list[str]:
    return [element.value for element in at.markdown]


def test_a_task_runs_once_for_all_sessions(page: AppTest) -> None:
    calls: list[str] = []
    page.session_state["tasks"] = {"a": lambda _: calls.append("a") or 1, "b": lambda _: 2}
    assert texts(shown(page.run())) == ["a: 1", "b: 2"]
    assert texts(shown(page.run())) == ["a: 1", "b: 2"]
    assert calls == ["a"]


def test_a_refused_task_is_reported_and_the_others_continue(page: AppTest) -> None:
    def refuse(_: Progress) -> int:
        raise JointIdError("No log.")

    page.session_state["tasks"] = {"a": refuse, "b": lambda _: 2}
    at = shown(page.run())
    assert [error.value for error in at.error] == ["No log."]
    assert texts(at) == ["b: 2"]


def test_an_internal_error_is_raised(page: AppTest) -> None:
    page.session_state["tasks"] = {"a": lambda _: 1 // 0}
    assert len(page.run().exception) == 1


def test_a_stopped_job_ends_and_can_be_resumed(page: AppTest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importing_work, "SHOWN_AFTER_S", 0.01)
    ended = threading.Event()
    tries: list[int] = []

    def slow(tell: Progress) -> int:
        tries.append(1)
        if len(tries) == 2:
            return 7
        tell.__self__.stopped.set()  # type: ignore[attr-defined]  # as the button does
        try:
            while True:
                tell(0.5)
                time.sleep(0.01)
        finally:
            ended.set()

    page.session_state["tasks"] = {"a": lambda _: 1, "b": slow, "c": lambda _: 3}
    page.run()
    assert ended.wait(5)
    at = shown(page.run())
    assert texts(at) == ["a: 1"]
    assert "Stopped at file 2 of 3" in at.info[0].value
    at.button[0].click()
    assert texts(shown(at.run())) == ["a: 1", "b: 7", "c: 3"]
    assert not at.info


def test_a_job_reports_progress_and_stops() -> None:
    go, told = threading.Event(), threading.Event()

    def task(tell: Progress) -> None:
        tell(0.25)
        told.set()
        go.wait(5)
        tell(0.5)

    job = Job(task)
    assert told.wait(5)
    assert job.share == 0.25
    job.stopped.set()
    go.set()
    assert isinstance(job.outcome.exception(5), StoppedError)


def test_jobs_of_many_sessions_take_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each may take gigabytes: the second waits, can be stopped meanwhile, and runs after the first."""
    monkeypatch.setattr(importing_work, "_AT_ONCE", threading.Semaphore(1))
    done = threading.Event()
    first = Job(lambda _: done.wait(20))
    stopped, second = Job(lambda _: 2), Job(lambda _: 3)
    while not (stopped.waits and second.waits):
        time.sleep(0.01)
    stopped.stopped.set()
    with pytest.raises(StoppedError):
        stopped.outcome.result(10)
    assert not second.outcome.done()
    done.set()
    assert (first.outcome.result(10), second.outcome.result(10)) == (True, 3)


def test_the_search_reports_growing_progress_and_can_be_stopped() -> None:
    time_s, theta, tau = runs()
    gap = np.where(time_s > 5.8, 30.0, 0.0)  # two parts
    log = MappedLog(time_s + gap, theta[:, None], tau[:, None])
    shares: list[float] = []
    found = find_segments(log, progress=shares.append)
    assert found == find_segments(log)
    assert shares == sorted(shares)
    assert shares[0] == 0
    assert 0.5 < shares[-1] <= 1

    def end(share: float) -> None:
        if share > 0.3:
            raise StoppedError("Stopped.")

    with pytest.raises(StoppedError):
        find_segments(log, progress=end)
