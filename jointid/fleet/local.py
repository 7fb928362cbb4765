"""Analysis on this computer, in one child process per worker."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Generator, Sequence

from jointid.background.child_process import Child, Limits
from jointid.errors import JointIdError
from jointid.fleet.jobs import WORKER, Done, Job, do_job

_POLL_S = 0.2


class Local:
    """Child processes on this computer, each with one BLAS thread.

    Parameters
    ----------
    workers : int
        How many at a time.
    limits : Limits
        Time and memory for one study.
    waiting : callable, optional
        Called a few times a second between results. Its exceptions leave ``run`` and end the processes
        at once.

    Raises
    ------
    JointIdError
        When there is less than one worker.
    """

    def __init__(
        self,
        workers: int = 1,
        limits: Limits | None = None,
        *,
        waiting: Callable[[], None] | None = None,
    ) -> None:
        if workers < 1:
            raise JointIdError(f"workers = {workers}: at least one is needed.")
        self._workers = workers
        self._limits = limits or Limits()
        self._waiting = waiting

    def run(self, jobs: Sequence[Job]) -> Generator[Done, None, None]:
        """Yield finished jobs; closing the generator ends the processes."""
        todo, done = iter(jobs), queue.SimpleQueue[Done | Exception]()
        lock, stopped = threading.Lock(), threading.Event()
        children = [Child(WORKER, self._limits) for _ in range(min(self._workers, len(jobs)))]

        def work(child: Child) -> None:
            try:
                while True:
                    with lock:
                        job = None if stopped.is_set() else next(todo, None)
                    if job is None:
                        return
                    done.put(do_job(child, job))
            except Exception as error:  # without it the generator would wait forever
                done.put(error)
            finally:
                child.stop()

        threads = [threading.Thread(target=work, args=(child,), daemon=True) for child in children]
        for thread in threads:
            thread.start()
        try:
            for _ in jobs:
                result = self._next(done)
                if isinstance(result, Exception):
                    raise result
                yield result
        finally:
            stopped.set()
            for child in children:
                child.kill()
            for thread in threads:
                thread.join()

    def _next(self, done: queue.SimpleQueue[Done | Exception]) -> Done | Exception:
        while self._waiting is not None:
            try:
                return done.get(timeout=_POLL_S)
            except queue.Empty:
                self._waiting()
        return done.get()
