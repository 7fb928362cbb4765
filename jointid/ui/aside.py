"""Where a computation disturbs least: in a process of its own, or here when nobody else computes.

Sessions share one interpreter, so that ten computations at once would slow everybody's every click
tenfold. One person alone needs no other process; the first computation that would have to wait for
another one has them begin.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from threading import Semaphore
from typing import Any, ParamSpec, TypeVar

import streamlit as st

from jointid.processes.pool import NoneReadyError, Pool

Given = ParamSpec("Given")
Found = TypeVar("Found")
_MOST_PROCESSES = 4
_PATIENCE_S = 5.0
_LONGEST_TURN_S = 1.0
_turn = Semaphore(1)

# Who computes hands the interpreter on ten times as often as by default: short reruns wait less.
sys.setswitchinterval(5e-4)


@st.cache_resource(show_spinner=False)
def _pool() -> Pool:
    return Pool(min(_MOST_PROCESSES, os.cpu_count() or 1))


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
    progress: Any = named.pop("progress", None)
    function: Callable[..., Found] = partial(compute, **named) if named else compute
    pool = _pool()
    with suppress(NoneReadyError):
        found: Found = pool.call(function, *given, progress=progress, patience_s=_PATIENCE_S)
        return found
    mine = _turn.acquire(blocking=False)
    if not mine:
        pool.begin()
        mine = _turn.acquire(timeout=_LONGEST_TURN_S)  # not for ever: a turn may be long
    try:
        return function(*given) if progress is None else function(*given, progress=progress)
    finally:
        if mine:
            _turn.release()
