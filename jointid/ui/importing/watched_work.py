"""Long jobs with a progress bar, the time left and a stop button.

Each job runs in its own thread while the page shows its progress. A click elsewhere reruns the page,
which finds the job still running; results are cached for all sessions.
"""

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import Generic, TypeVar

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from jointid import JointIdError
from jointid.ui.shared.results import STOPPABLE_AFTER_S, result_cache, steps_at

T = TypeVar("T")
Progress = Callable[[float], None]

SHOWN_AFTER_S = 0.5
_POLL_S = 0.1
_JOBS = "import_jobs"
_AT_ONCE = threading.Semaphore(2)
"""Jobs of all sessions at once: each may take a processor and, to read a log, gigabytes."""


class StoppedError(JointIdError):
    """The user has stopped a job."""


class Job(Generic[T]):
    """One running job."""

    def __init__(self, task: Callable[[Progress], T]) -> None:
        self.share, self.began, self.waits = 0.0, time.monotonic(), False
        self.stopped = threading.Event()
        self.outcome: Future[T] = Future()
        threading.Thread(target=self._run, args=(task,), daemon=True).start()

    def _run(self, task: Callable[[Progress], T]) -> None:
        try:
            while not _AT_ONCE.acquire(timeout=_POLL_S):
                self.waits = True
                self._tick(0.0)
            self.waits = False
            try:
                self.outcome.set_result(task(self._tick))
            finally:
                _AT_ONCE.release()
        except BaseException as error:  # the page that waits judges it
            self.outcome.set_exception(error)

    def _tick(self, share: float) -> None:
        self.share = share
        if self.stopped.is_set():
            raise StoppedError("Stopped.")


class Watch:
    """A number of jobs in sequence, with one progress bar at a place, an ``st.empty()``."""

    def __init__(self, total: int, place: DeltaGenerator) -> None:
        self._total, self._number, self._place = total, 0, place

    def do(self, key: str, label: str, task: Callable[[Progress], T]) -> T:
        """Return the result of a job, from the cache if one with the same key has run before.

        ``label`` describes the work: "Reading one.csv". The task gets a function to report the share
        done, which raises when the job is stopped, and must not use streamlit. Raises StoppedError when
        the user has stopped it, and any JointIdError of the task.
        """
        self._number += 1
        outcome = result_cache().get(key)
        if outcome is None:
            outcome = self._await(key, label, task)
            result_cache().put(key, outcome)
        if isinstance(outcome, JointIdError):
            raise outcome
        finished: T = outcome
        return finished

    def _await(self, key: str, label: str, task: Callable[[Progress], T]) -> T | JointIdError:
        jobs: dict[str, Job[T]] = st.session_state.setdefault(_JOBS, {})
        if key not in jobs:
            for other in [k for k, job in jobs.items() if not job.stopped.is_set()]:
                jobs.pop(other).stopped.set()  # started with entries that have changed
            jobs[key] = Job(task)
        job = jobs[key]
        if not job.stopped.is_set() and wait([job.outcome], SHOWN_AFTER_S).not_done:
            self._show_progress(key, label, job)
        if job.stopped.is_set():
            with self._place.container(horizontal=True, vertical_alignment="center"):
                st.info(f"Stopped{self._at_file(' at')}.")
                st.button("Resume", key=f"resume_{key}", on_click=jobs.clear)
            raise StoppedError("Stopped.")
        jobs.pop(key, None)
        error = job.outcome.exception()
        if error is not None and not isinstance(error, JointIdError):
            raise error
        return error or job.outcome.result()

    def _at_file(self, before: str) -> str:
        return f"{before} file {self._number} of {self._total}" if self._total > 1 else ""

    def _show_progress(self, key: str, label: str, job: Job[T]) -> None:
        with self._place.container():
            bar, button = st.progress(0.0), st.empty()
        show, stoppable = steps_at(bar, job.began), False
        while wait([job.outcome], _POLL_S).not_done:
            queued = ": waiting for other imports" if job.waits else ""
            show(job.share, f"{label}{self._at_file(',')}{queued}")
            if not stoppable and time.monotonic() - job.began > STOPPABLE_AFTER_S:
                button.button("Stop here", key=f"stop_{key}", on_click=job.stopped.set)
                stoppable = True
        self._place.empty()
