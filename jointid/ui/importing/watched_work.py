"""Work that is watched: it says what is being done and what is left, and it can be stopped.

Each piece runs in a thread of its own while the page looks on. A click on something else draws the page
again and finds the piece still running; a finished piece is remembered for every session.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Generic, TypeVar

import streamlit as st

from jointid import JointIdError
from jointid.ui.shared.messages import show_progress
from jointid.ui.shared.results import result_cache

T = TypeVar("T")
Progress = Callable[[float], None]

SHOWN_AFTER_S = 0.5
STOPPABLE_AFTER_S = 5.0
_LOOK_S = 0.1
_JOBS = "import_jobs"


class StoppedError(JointIdError):
    """The user has stopped a piece of work."""


class Job(Generic[T]):
    """One piece of work under way."""

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
        except BaseException as error:  # it belongs to the page that waits for it
            self.fault = error
        finally:
            self.ended.set()

    def _tick(self, share: float) -> None:
        self.share = share
        if self.stopped.is_set():
            raise StoppedError("Stopped.")


class Watch:
    """Several pieces of work, one after the other, behind one progress bar.

    Parameters
    ----------
    what : str
        For the button that goes on after a stop: "Read on".
    total : int
        How many pieces there are.
    """

    def __init__(self, what: str, total: int) -> None:
        self._what, self._total, self._number = what, total, 0
        self._place = st.empty()
        self._began = time.monotonic()
        self._fresh = 0  # pieces that were not done already

    def do(self, key: str, label: str, task: Callable[[Progress], T]) -> T:
        """Return what a piece of work comes to, from memory where it was done before.

        Parameters
        ----------
        key : str
            What it is known by; equal keys have equal outcomes.
        label : str
            What is being done: "Reading one.csv".
        task : callable
            Gets a function that it may tell the share done; that one raises when it is to stop. It must
            not use streamlit.

        Raises
        ------
        StoppedError
            When it was stopped.
        JointIdError
            What the task raises.
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
                jobs.pop(other).stopped.set()  # of entries that have changed since
            jobs[key] = Job(task)
        job = jobs[key]
        if not job.stopped.is_set() and not job.ended.wait(SHOWN_AFTER_S):
            self._look_on(key, label, job)
        if job.stopped.is_set():
            self._say_stopped(key)
            raise StoppedError("Stopped.")
        jobs.pop(key, None)
        if job.fault is not None:
            raise job.fault
        self._fresh += 1
        assert job.outcome is not None
        return job.outcome

    def _look_on(self, key: str, label: str, job: Job[T]) -> None:
        began = min(self._began, job.began)
        with self._place.container():
            bar, button = st.progress(0.0), st.empty()
        stoppable = False
        while not job.ended.wait(_LOOK_S):
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

    def _say_stopped(self, key: str) -> None:
        with self._place.container(horizontal=True, vertical_alignment="center"):
            st.info(
                "Stopped" + (f" at file {self._number} of {self._total}." if self._total > 1 else ".")
            )
            st.button(self._what, key=f"go_on_{key}", on_click=_go_on, args=(key,))


def _go_on(key: str) -> None:
    st.session_state.get(_JOBS, {}).pop(key, None)
