"""Where a computation disturbs least: in a process of its own, or here when nobody else computes.

Sessions share one interpreter, so that ten computations at once would slow everybody's every click
tenfold. One person alone needs no other process; the second one has them begin.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Hashable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import suppress
from functools import cache, partial
from threading import Lock, Semaphore
from typing import Any, ParamSpec, TypeVar

import streamlit as st
from streamlit.runtime.scriptrunner import get_script_run_ctx

from jointid.background.pool import NoWorkerError, Pool

Given = ParamSpec("Given")
Found = TypeVar("Found")
_MOST_PROCESSES = 4
_PRELOADED = (
    "jointid.study",
    "jointid.cut.outcome",
    "jointid.uncertainty.plan",
    "jointid.uncertainty.sensitivity",
)
"""What the pages compute with: the first click need not wait for these imports."""
_PATIENCE_S = 5.0
_LONGEST_TURN_S = 1.0
_turn = Semaphore(1)
_at_work = ""
"""The session that computed something here last."""

# Who computes hands the interpreter on ten times as often as by default: short reruns wait less.
sys.setswitchinterval(5e-4)


_threads = ThreadPoolExecutor(16, thread_name_prefix="aside")
"""They wait for processes; what they compute here they compute in turn."""


@cache
def _pool() -> Pool:
    return Pool(min(_MOST_PROCESSES, os.cpu_count() or 1), _PRELOADED)


def aside(compute: Callable[Given, Found], *given: Given.args, **named: Given.kwargs) -> Found:
    """Return ``compute(*given, **named)``.

    Parameters
    ----------
    compute : callable
        Of a module, without side effects.
    *given
        What it needs; what of it is in the result is the same object.
    **named
        The same, apart from ``progress``, which is called here.

    Raises
    ------
    JointIdError
        When it ended its process; and whatever it raises.
    """
    return _computed(_session(), compute, *given, **named)


def _session() -> str:
    context = get_script_run_ctx(suppress_warning=True)
    return "" if context is None else context.session_id


def _computed(
    session: str, compute: Callable[Given, Found], *given: Given.args, **named: Given.kwargs
) -> Found:
    global _at_work
    progress: Any = named.pop("progress", None)
    function: Callable[..., Found] = partial(compute, **named) if named else compute
    pool = _pool()
    with suppress(NoWorkerError):
        found: Found = pool.call(function, *given, progress=progress, patience_s=_PATIENCE_S)
        return found
    if session != _at_work != "":
        pool.start()
    _at_work = session
    mine = _turn.acquire(timeout=_LONGEST_TURN_S)  # not for ever: a turn may be long
    try:
        return function(*given) if progress is None else function(*given, progress=progress)
    finally:
        if mine:
            _turn.release()


class Kept:
    """Results computed aside, once for all sessions and several at a time.

    Parameters
    ----------
    most : int
        How many are kept; the oldest make room.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._lock = Lock()
        self._begun: dict[Hashable, Future[Any]] = {}

    def begin(
        self,
        key: Hashable,
        compute: Callable[Given, Found],
        *given: Given.args,
        **named: Given.kwargs,
    ) -> Future[Found]:
        """Begin a computation, unless one of this key was begun and has not failed."""
        with self._lock:
            known = self._begun.pop(key, None)
            if known is None or (known.done() and known.exception() is not None):
                known = _threads.submit(partial(_computed, _session(), compute, *given, **named))
            self._begun[key] = known
            while len(self._begun) > self._most:
                del self._begun[next(iter(self._begun))]
            return known


def awaited(what: str, *begun: Future[Any]) -> None:
    """Wait for computations; the page says what is done meanwhile."""
    if not all(future.done() for future in begun):
        with st.spinner(what):
            wait(begun)
