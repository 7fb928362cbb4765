"""A study to analyse, its result, and its analysis by child processes."""

import queue
import threading
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jointid.background.child_process import Child, Ended, Limits
from jointid.errors import JointIdError
from jointid.fleet.row import CRASH, TIME, Row, failed_row, from_plain, to_plain

WORKER = "jointid.fleet.worker"
"""Module that the child processes run."""


@dataclass(frozen=True)
class Job:
    """A study to analyse."""

    study: str
    """Its name in the table."""
    source: Path | bytes
    """A folder or .zip by its path, or a zip."""
    method: str = "auto"
    known: str = ""
    """Digest of the files of an existing row; an equal study is not analysed again."""
    content: str = ""
    """Digest of the files that ``source`` was made from; by default that of ``source``."""


@dataclass(frozen=True)
class Done:
    """A finished job."""

    job: Job
    row: Row | None
    """None when its files are unchanged."""


def do_job(child: Child, job: Job) -> Done:
    """Analyse a study in a child process, on this computer or on a cluster.

    Raises JointIdError when no process can be started.
    """
    answer, _ = ask_child(child, job, "analyse")
    return Done(job, from_plain(answer["row"]) if "row" in answer else None)


def ask_child(child: Child, job: Job, what: str) -> tuple[dict[str, Any], bytes]:
    """Send a job; the answer holds a row, "unchanged", or the requested data."""
    path, body = (str(job.source), b"") if isinstance(job.source, Path) else ("", job.source)
    about = {name: getattr(job, name) for name in ("study", "method", "known", "content")}
    try:
        return child.ask({"do": what, "path": path} | about, body)
    except Ended as ended:
        failure = TIME if ended.late else CRASH
        return {"row": to_plain(failed_row(job.study, job.method, failure, str(ended)))}, b""


_POLL_S = 0.2


class Local:
    """Child processes on this computer, one for each worker, each with one BLAS thread.

    ``limits`` are time and memory for one study. ``waiting`` is called a few times a second between
    results; its exceptions leave ``run`` and end the processes at once. Raises JointIdError without a
    worker.
    """

    def __init__(
        self, workers: int, limits: Limits, *, waiting: Callable[[], None] = lambda: None
    ) -> None:
        if workers < 1:
            raise JointIdError(f"workers = {workers}: at least one is needed.")
        self._workers = workers
        self._limits = limits
        self._waiting = waiting

    def run(self, jobs: Sequence[Job]) -> Generator[Done, None, None]:
        """Yield finished jobs in any order, each once; closing the generator ends the processes.

        Raises JointIdError when no further job of any study is possible.
        """
        children: list[Child] = []
        done, own = queue.SimpleQueue[Future[Done]](), threading.local()

        def begin() -> None:
            own.child = Child(WORKER, self._limits)
            children.append(own.child)

        pool = ThreadPoolExecutor(self._workers, initializer=begin)
        try:
            for job in jobs:
                pool.submit(lambda job: do_job(own.child, job), job).add_done_callback(done.put)
            left = len(jobs)
            while left:
                try:
                    finished = done.get(timeout=_POLL_S)
                except queue.Empty:
                    self._waiting()
                else:
                    left -= 1
                    yield finished.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            for child in children:
                child.kill()
            pool.shutdown()
            for child in children:
                child.stop()
