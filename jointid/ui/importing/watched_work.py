"""Long jobs with a progress bar, the time left and a stop button.

Each job runs in its own thread while the page shows its progress. A click elsewhere reruns the page,
which finds the job still running; results are cached for all sessions.
"""

import threading
import time
from collections.abc import Callable
from typing import Generic, TypeVar

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from jointid import JointIdError
from jointid.ui.shared.messages import show_progress
from jointid.ui.shared.results import result_cache

T = TypeVar("T")
Progress = Callable[[float], None]

SHOWN_AFTER_S = 0.5
STOPPABLE_AFTER_S = 5.0
_POLL_S = 0.1
_JOBS = "import_jobs"


class StoppedError(JointIdError):
    """The user has stopped a job."""


class Job(Generic[T]):
    """One running job."""

    def __init__(self, task: Callable[[Progress], T]) -> None:
        self.share, self.began = 0.0, time.monotonic()
        self.ended, self.stopped = threading.Event(), threading.Event()
        self.outcome: T | JointIdError | None = None
        self.fault: BaseException | None = None
        self._task = task
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        try:
            self.outcome = self._task(self._tick)
        except JointIdError as error:
            self.outcome = error
        except BaseException as error:  # raised again by the page that waits
            self.fault = error
        finally:
            self.ended.set()

    def _tick(self, share: float) -> None:
        self.share = share
        if self.stopped.is_set():
            raise StoppedError("Stopped.")


class Watch:
    """Several jobs in sequence, with one progress bar.

    Parameters
    ----------
    total : int
        Number of pieces.
    place : DeltaGenerator
        Where the progress is shown: an ``st.empty()``.
    """

    def __init__(self, total: int, place: DeltaGenerator) -> None:
        self._total, self._number = total, 0
        self._place = place
        self._began = time.monotonic()
        self._fresh = 0  # jobs without a cached result

    def do(self, key: str, label: str, task: Callable[[Progress], T]) -> T:
        """Return the result of a job, from the cache if it has run before.

        Parameters
        ----------
        key : str
            Key of the cache; equal keys have equal results.
        label : str
            Description of the work: "Reading one.csv".
        task : callable
            Gets a function to report the share done, which raises when the job is stopped. It must
            not use streamlit.

        Raises
        ------
        StoppedError
            When the user has stopped it.
        JointIdError
            Any error of the task.
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
        if not job.stopped.is_set() and not job.ended.wait(SHOWN_AFTER_S):
            self._show_progress(key, label, job)
        if job.stopped.is_set():
            self._show_stopped(key)
            raise StoppedError("Stopped.")
        jobs.pop(key, None)
        if job.fault is not None:
            raise job.fault
        self._fresh += 1
        assert job.outcome is not None
        return job.outcome

    def _show_progress(self, key: str, label: str, job: Job[T]) -> None:
        began = min(self._began, job.began)
        with self._place.container():
            bar, button = st.progress(0.0), st.empty()
        stoppable = False
        while not job.ended.wait(_POLL_S):
            elapsed = time.monotonic() - began
            done = self._fresh + job.share
            of = f", file {self._number} of {self._total}" if self._total > 1 else ""
            text = f"{label}{of}"
            if elapsed > STOPPABLE_AFTER_S:
                left = elapsed * (self._total - self._number + 1 - job.share) / done if done else 0.0
                text += f"; about {left:.0f} s left" if left else f"; {elapsed:.0f} s so far"
                if not stoppable:
                    button.button("Stop here", key=f"stop_{key}", on_click=job.stopped.set)
                    stoppable = True
            share = (self._number - 1 + job.share) / self._total
            show_progress(share, text, bar)
        self._place.empty()

    def _show_stopped(self, key: str) -> None:
        with self._place.container(horizontal=True, vertical_alignment="center"):
            st.info(
                "Stopped" + (f" at file {self._number} of {self._total}." if self._total > 1 else ".")
            )
            st.button("Resume", key=f"resume_{key}", on_click=_resume, args=(key,))


def _resume(key: str) -> None:
    st.session_state.get(_JOBS, {}).pop(key, None)
