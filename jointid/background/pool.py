"""A few processes that stand ready for calls."""

from __future__ import annotations

import math
import queue
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from jointid.background.calls import packed_call, unpacked_result
from jointid.background.child_process import Child, Ended, Limits
from jointid.errors import JointIdError

_MODULE = "jointid.background.calls"
_LIMITS = Limits(time_s=3600.0)
_BEGINNING_S = 20.0
"""How long a process may take to begin; it loads the numerical libraries."""
_AGAIN_S = 30.0
"""How long none is begun after one that could not."""


class NoneReadyError(Exception):
    """No process is ready: the caller may compute by itself."""


class Pool:
    """Processes for calls, none before they are wished for.

    Parameters
    ----------
    most : int
        How many.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._there = self._ready = 0  # the one that is beginning is there, but not ready
        self._not_before = -math.inf
        self._lock = threading.Lock()
        self._idle: queue.SimpleQueue[Child] = queue.SimpleQueue()

    def begin(self) -> None:
        """Have one more process begin, if there may be one; nobody waits for it."""
        with self._lock:
            at_it = self._there > self._ready
            if at_it or self._there >= self._most or time.monotonic() < self._not_before:
                return
            self._there += 1
        try:
            threading.Thread(target=self._begin_one, daemon=True).start()
        except RuntimeError:  # no more threads
            self._failed()

    def call(
        self,
        function: Callable[..., Any],
        *given: Any,
        progress: Callable[..., object] | None = None,
        patience_s: float = 0.0,
    ) -> Any:
        """Have a process call ``function(*given)``.

        Parameters
        ----------
        function : callable
            Of a module, or a ``functools.partial`` of one.
        *given
            What it is called with. What of it comes back is the same object.
        progress : callable, optional
            Left out, the function gets no ``progress``. What it raises ends the call.
        patience_s : float
            How long to wait for a process that is at another call.

        Raises
        ------
        NoneReadyError
            When none is there, or none has become free.
        JointIdError
            When the call ended its process; and whatever the call raises.
        """
        if not self._ready:
            raise NoneReadyError
        try:
            return self._asked(self._free(patience_s), function, given, progress)
        except Ended as ended:
            why = str(ended)
        with suppress(Ended, NoneReadyError):  # perhaps this call was not to blame
            child = self._free(_BEGINNING_S, beginning=True)
            return self._asked(child, function, given, progress)
        raise JointIdError(
            f"The computation cannot be made. {why} Free memory on the computer that serves this page, "
            "or shorten the records; then load the page again."
        )

    def stop(self) -> None:
        """End the processes that are at no call, and begin no others."""
        self._most = 0
        while True:
            try:
                self._idle.get_nowait().stop()
            except queue.Empty:
                return

    def _asked(
        self,
        child: Child,
        function: Callable[..., Any],
        given: Sequence[Any],
        progress: Callable[..., object] | None,
    ) -> Any:
        try:
            call = packed_call(function, given, progress is not None)
            _, result = child.ask({}, call, progress)
        finally:
            self._put_back(child)
        return unpacked_result(result, given)

    def _begin_one(self) -> None:
        child = Child(_MODULE, _LIMITS)
        try:
            child.begin()
        except Exception:  # whatever it is: the callers compute by themselves, for a while
            self._failed()
            return
        with self._lock:
            self._ready += 1
        self._put_back(child)

    def _failed(self) -> None:
        with self._lock:
            self._not_before = time.monotonic() + _AGAIN_S
            self._there -= 1

    def _free(self, patience_s: float, *, beginning: bool = False) -> Child:
        """Return a process that waits for a call, or one that is just beginning."""
        while True:
            try:
                child = self._idle.get_nowait()
            except queue.Empty:
                self.begin()
                if not self._ready and not beginning:
                    raise NoneReadyError from None
                child = self._awaited(patience_s)
            if child.runs:
                return child
            self._put_back(child)  # was idle for long, or somebody ended it

    def _awaited(self, patience_s: float) -> Child:
        try:
            return self._idle.get(timeout=patience_s)
        except queue.Empty:
            raise NoneReadyError from None

    def _put_back(self, child: Child) -> None:
        if child.runs and self._most:
            self._idle.put(child)
            return
        child.stop()
        with self._lock:
            self._there -= 1
            self._ready -= 1
