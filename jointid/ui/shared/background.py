"""Long computations in a worker process, or in this one while only one session computes.

Sessions share one interpreter: ten parallel computations would slow every click tenfold. A single
session needs no worker processes; the second one starts them.
"""

import os
import sys
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import suppress
from functools import cache, partial
from threading import Semaphore
from time import monotonic
from typing import Any, ParamSpec, TypeVar

import streamlit as st
from streamlit.runtime.scriptrunner import get_script_run_ctx

from jointid.background.pool import NoWorkerError, Pool
from jointid.wording import counted

Given = ParamSpec("Given")
Found = TypeVar("Found")
_PROCESSES = min(4, os.cpu_count() or 1)
_PRELOADED = (
    "jointid.study",
    "jointid.cut.outcome",
    "jointid.uncertainty.plan",
    "jointid.uncertainty.sensitivity",
)
"""Imported when a worker starts, so that its first computation need not wait."""
_PATIENCE_S = 5.0
_LONGEST_TURN_S = 1.0
_turn = Semaphore(1)
_at_work = ""
"""The session that last computed in this process."""

# A tenth of the default: short reruns wait less for the thread that computes.
sys.setswitchinterval(5e-4)

_asked: set[object] = set()
"""Computations of all sessions that have no result yet."""

last_seen: dict[str, float] = {}
"""Time of the last page of each session: the server closes sessions whose tab has closed, s."""

_threads = ThreadPoolExecutor(16, thread_name_prefix="background")
"""They wait for worker processes; computations in this process take turns."""


@cache
def _pool() -> Pool:
    return Pool(_PROCESSES, _PRELOADED)


def run_in_background(
    compute: Callable[Given, Found], *given: Given.args, **named: Given.kwargs
) -> Found:
    """Return ``compute(*given, **named)``.

    Parameters
    ----------
    compute : callable
        A function of a module, without side effects.
    *given
        Arguments; one that is part of the result comes back as the same object.
    **named
        Keyword arguments; ``progress`` is called in this process.

    Raises
    ------
    JointIdError
        When the computation ends its process; and whatever it raises.
    """
    return _computed(_session(), compute, *given, **named)


def note_session() -> None:
    """Note when the session of this run was last seen."""
    last_seen[_session()] = monotonic()


def _session() -> str:
    context = get_script_run_ctx(suppress_warning=True)
    return "" if context is None else context.session_id


def _computed(
    session: str, compute: Callable[Given, Found], *given: Given.args, **named: Given.kwargs
) -> Found:
    mine = object()
    _asked.add(mine)
    try:
        progress: Any = named.pop("progress", None)
        function: Callable[..., Found] = partial(compute, **named) if named else compute
        with suppress(NoWorkerError):
            found: Found = _pool().call(function, *given, progress=progress, patience_s=_PATIENCE_S)
            return found
        return _computed_here(session, partial(function, *given), progress)
    finally:
        _asked.discard(mine)


def _computed_here(session: str, compute: Callable[..., Found], progress: Any) -> Found:
    """Compute in this process; the second session starts the workers."""
    global _at_work
    if session != _at_work != "":
        _pool().start()
    _at_work = session
    mine = _turn.acquire(timeout=_LONGEST_TURN_S)  # bounded: a turn may be long
    try:
        return compute() if progress is None else compute(progress=progress)
    finally:
        if mine:
            _turn.release()


def submit(compute: Callable[Given, Found], *given: Given.args, **named: Given.kwargs) -> Future[Found]:
    """Begin ``run_in_background(compute, *given, **named)`` without waiting for it."""
    return _threads.submit(partial(_computed, _session(), compute, *given, **named))


def queue_text(own: int = 0) -> str:
    """Say how many computations come before ``own`` ones; empty while a processor is free."""
    ahead = len(_asked) - own + 1 - _PROCESSES
    return "" if ahead <= 0 else f"The server is busy: {counted(ahead, 'computation')} in the queue."


def awaited(what: str, *begun: Future[Any]) -> None:
    """Wait for computations; meanwhile the page shows ``what`` and a queue."""
    if not all(future.done() for future in begun):
        with st.spinner(". ".join(filter(None, (what, queue_text(len(begun)))))):
            wait(begun)
