"""Long computations of all sessions, and the one cache of their results."""

import os
import sys
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from functools import cache, partial
from threading import Lock, Semaphore, Timer
from time import monotonic
from typing import Any, Literal, ParamSpec, TypeVar

import streamlit as st
from streamlit.delta_generator import DeltaGenerator
from streamlit.runtime.scriptrunner import get_script_run_ctx

from jointid import JointIdError
from jointid.background.pool import NoWorkerError, Pool, Stop, packed
from jointid.ui.shared.messages import markdown_escape, show_error
from jointid.wording import counted

Given = ParamSpec("Given")
Found = TypeVar("Found")
_PROCESSES = min(4, (os.cpu_count() or 1) + 1)
"""One more than processors: a long computation then holds up no short one."""
_PRELOADED = (
    "jointid.study",
    "jointid.cut.outcome",
    "jointid.uncertainty.plan",
    "jointid.uncertainty.information",
)
"""Imported when a worker starts, so that its first computation need not wait."""
_UNDISTURBED_S = 2.0
"""Time for the first page of a server, whose first picture workers that start would delay by 0.6 s."""
_LONGEST_TURN_S = 1.0
_MOST_BYTES = 1 << 28
_TIME_LEFT_AFTER_S = 0.5
"""After this time the remaining time is shown, or that so far."""
_ALWAYS_KEPT = 12
"""Latest results, kept whatever their size: a page needs those of its last run."""
_POLL_S = 0.2
_turn = Semaphore(1)
STOPPABLE_AFTER_S = 5.0
"""Time after which work can be stopped."""

# A tenth of the default: short reruns wait less for the thread that computes.
sys.setswitchinterval(5e-4)

_asked: set[object] = set()
"""Computations of all sessions that have no result yet."""

last_seen: dict[str, float] = {}
"""Time of the last page of each session: the server closes sessions whose tab has closed, s."""

_threads = ThreadPoolExecutor(16, thread_name_prefix="background")
"""They wait for worker processes; before there are any, computations here take turns."""


@cache
def _pool() -> Pool:
    return Pool(_PROCESSES, _PRELOADED)


def run_in_background(
    compute: Callable[Given, Found], *given: Given.args, **named: Given.kwargs
) -> Found:
    """Return ``compute(*given, **named)`` for a function of a module without side effects.

    What is given and is part of the result comes back as the same object; ``progress`` is called in
    this process. Raises JointIdError when the computation ends its process; and whatever it raises.
    """
    return _computed(_session(), Stop(), compute, *given, **named)


def note_session() -> None:
    """Note when the session of this run was last seen."""
    last_seen[_session()] = monotonic()


def _session() -> str:
    context = get_script_run_ctx(suppress_warning=True)
    return "" if context is None else context.session_id


def _computed(
    session: str, stop: Stop, compute: Callable[Given, Found], *given: Given.args, **named: Given.kwargs
) -> Found:
    mine = object()
    _asked.add(mine)
    try:
        progress: Any = named.pop("progress", None)
        function: Callable[..., Found] = partial(compute, **named) if named else compute
        while True:
            with suppress(NoWorkerError):
                found: Found = _pool().call(function, *given, progress=progress, stop=stop)
                return found
            # Not in this process once there are others: it would slow all pages.
            with _turn_here(session):
                stop.check()
                if not _pool().is_ready:
                    return function(*given, **({} if progress is None else {"progress": progress}))
    finally:
        _asked.discard(mine)


@contextmanager
def _turn_here(session: str) -> Iterator[None]:
    """Wait a while for a turn in this process; soon after the first page the workers start."""
    if session:
        later = Timer(_UNDISTURBED_S, _pool().start)
        later.daemon = True
        later.start()
    mine = _turn.acquire(timeout=_LONGEST_TURN_S)  # bounded: a turn may be long
    try:
        yield
    finally:
        if mine:
            _turn.release()


class Computation(Future[Found]):
    """A computation in the background, and what stops it.

    In a worker process it ends at once; in this process, before the first worker is ready, it runs on
    and its result is kept.
    """

    def __init__(self) -> None:
        super().__init__()
        self.stop = Stop()

    def run(self, compute: Callable[[], Found]) -> None:
        """Take the result, or the exception, of a function."""
        try:
            self.set_result(compute())
        except BaseException as error:  # raised where the result is asked for
            self.set_exception(error)


def submit(
    compute: Callable[Given, Found], *given: Given.args, **named: Given.kwargs
) -> Computation[Found]:
    """Begin ``run_in_background(compute, *given, **named)`` without waiting for it."""
    begun = Computation[Found]()
    _threads.submit(begun.run, partial(_computed, _session(), begun.stop, compute, *given, **named))
    return begun


def run_watched(
    show: Callable[[], object],
    compute: Callable[Given, Found],
    *given: Given.args,
    **named: Given.kwargs,
) -> Found:
    """Return ``run_in_background(compute, *given, **named)``, for functions without progress.

    ``show`` is called meanwhile; a click on Stop ends the run there, and with it the computation.
    """
    begun = submit(compute, *given, **named)
    try:
        while wait([begun], _POLL_S).not_done:
            show()
        return begun.result()
    finally:
        begun.stop.set()


def queue_text(own: int = 0) -> str:
    """Say how many computations come before ``own`` ones; empty while a processor is free."""
    ahead = len(_asked) - own + 1 - _PROCESSES
    return "" if ahead <= 0 else f"The server is busy: {counted(ahead, 'computation')} in the queue."


def awaited(what: str, *begun: Future[Any], stop: Callable[[], None] | None = None) -> None:
    """Wait for computations; meanwhile the page shows ``what`` and a queue.

    ``stop`` is called by a button that appears after five seconds.
    """
    if all(future.done() for future in begun):
        return
    with st.spinner(". ".join(filter(None, (what, queue_text(len(begun))))), show_time=True):
        button, left = st.empty(), st.empty()
        start, offered = monotonic(), False
        while wait(begun, _POLL_S).not_done:
            left.caption("It usually takes under a minute." * offered)  # a click ends this run here
            if stop and not offered and monotonic() - start > STOPPABLE_AFTER_S:
                button.button("Stop", key=f"stop {start}", on_click=stop)
                offered = True
        button.empty()
        left.empty()


class ResultCache:
    """Finished results and those being computed; the least recently used are dropped first.

    All results take about ``most_bytes``; the ``always_kept`` latest ones stay even beyond it.
    """

    def __init__(self, most_bytes: int = _MOST_BYTES, always_kept: int = _ALWAYS_KEPT) -> None:
        self._most_bytes, self._always_kept = most_bytes, always_kept
        self._lock = Lock()
        self._results: OrderedDict[Hashable, Computation[Any]] = OrderedDict()
        self._bytes: dict[Hashable, int] = {}

    def get(self, key: Hashable) -> Any:
        """Return a finished result, or None."""
        with self._lock:
            found = self._results.get(key)
            if found is None or not found.done() or found.exception() is not None:
                return None
            self._results.move_to_end(key)
            return found.result()

    def put(self, key: Hashable, result: Any) -> None:
        """Keep a result."""
        finished = Computation[Any]()
        finished.set_result(result)
        with self._lock:
            self._store(key, finished)
        self._measure(key, (), finished)

    def begin(
        self,
        key: Hashable,
        compute: Callable[Given, Found],
        *given: Given.args,
        **named: Given.kwargs,
    ) -> Computation[Found]:
        """Begin a background computation, unless one of this key has begun and not failed."""
        with self._lock:
            known = self._results.get(key)
            is_new = known is None or (known.done() and known.exception() is not None)
            future = submit(compute, *given, **named) if is_new or known is None else known
            self._store(key, future)
        if is_new:
            future.add_done_callback(partial(self._measure, key, given))
        return future

    def _store(self, key: Hashable, result: Computation[Any]) -> None:
        self._results[key] = result
        self._results.move_to_end(key)
        self._bytes.setdefault(key, 1)  # until it is measured
        self._drop_oldest()

    def _measure(self, key: Hashable, given: tuple[Any, ...], finished: Future[Any]) -> None:
        """Note the memory of a result without what was given and is part of it, such as the study."""
        if finished.exception() is not None:
            return
        size = len(packed(finished.result(), given))
        with self._lock:
            if self._results.get(key) is finished:
                self._bytes[key] = size
                self._drop_oldest()

    def _drop_oldest(self) -> None:
        while len(self._results) > self._always_kept and sum(self._bytes.values()) > self._most_bytes:
            oldest, _ = self._results.popitem(last=False)
            del self._bytes[oldest]


@st.cache_resource(show_spinner=False)
def result_cache() -> ResultCache:
    """Return the cache of this server."""
    return ResultCache()


Show = Callable[[float, str], None]
"""Shows the finished share of a computation and its current task."""


def computed_on_click(
    key: Hashable,
    label: str,
    name: str,
    compute: Callable[[Show], Found],
    *,
    kind: Literal["primary", "secondary"] = "secondary",
    at_once: bool = False,
) -> Found | None:
    """Return a kept result, or compute it after a click, with a progress bar and a button to stop.

    ``name`` is the button's key, ``kind`` its look; ``compute`` gets a function that shows progress, and
    its error is shown. ``at_once`` needs no click, unless this computation was stopped. Returns None
    before the click, and after an error.
    """
    # The place is there with a kept result too: what follows keeps its position on the page.
    place, stopped = st.empty(), f"{name} stopped"
    found: Found | None = result_cache().get(key)
    if found is not None:
        return found
    waits = not at_once or st.session_state.get(stopped) == key
    if waits and not place.button(label, key=name, type=kind):
        return None
    with place.container():
        bar = st.progress(0.0, "Computing")
        st.button(
            "Stop",
            key=f"{name}_stop",
            help="Stops the computation and discards it.",
            on_click=lambda: st.session_state.update({stopped: key}),
        )
    try:
        found = compute(steps_at(bar))
    except JointIdError as error:
        show_error(error, place)
        return None
    result_cache().put(key, found)
    place.empty()
    return found


def steps_at(bar: DeltaGenerator, began: float | None = None) -> Show:
    """Return a function that shows progress with an estimate of the time left."""
    start = monotonic() if began is None else began

    def show(done: float, what: str) -> None:
        taken = monotonic() - start
        left = f", {taken * (1 - done) / done:.0f} s left" if done > 0.05 else f", {taken:.0f} s so far"
        text = f"{what}: {done:.0%}{left * (taken > _TIME_LEFT_AFTER_S)}"
        bar.progress(min(max(done, 0.0), 1.0), markdown_escape(text))

    return show
