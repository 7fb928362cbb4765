"""Analysis on a Dask cluster: each study is sent as bytes and returned as its row.

A child process reads the files here, and child processes analyse them on the workers: a crash or hang
affects one study only. When a worker is lost, the scheduler gives its studies to others.
"""

import math
import queue
import threading
import time
import uuid
from collections.abc import Generator, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import dask
from distributed import Client, Future
from distributed.scheduler import KilledWorker

from jointid.background.child_process import Child, Limits
from jointid.errors import JointIdError
from jointid.files.application import __version__
from jointid.fleet.jobs import WORKER, Done, Job, ask_child, do_job
from jointid.fleet.row import LOST, Row, failed_row, from_plain

_CONNECT_S = 20.0  # longest wait for the scheduler and its first worker
_POLL_S = 1.0
_SENT_PER_THREAD = 3
"""Studies sent ahead for each thread of the cluster: they stay busy, few studies are in memory."""


class _Client(Client):
    """A client that only its owner closes, here ``Cluster``.

    The inherited destructor closes it too; a client that never connected, as with an address without a
    port, then waits 40 s at the end of the program for a loop that has ended.
    """

    def __del__(self) -> None:
        pass


class Cluster:
    """The workers of a Dask scheduler, at such as "tcp://10.0.0.5:8786"; limits are for one study.

    Raises JointIdError when the scheduler cannot be reached, has no worker, or a worker lacks this
    version of jointid.
    """

    def __init__(self, address: str, limits: Limits) -> None:
        self._limits = limits
        self._address = address
        self._batch = uuid.uuid4().hex
        self._size, self._asked_s = 1, -math.inf
        try:
            connect: Any = _Client
            self._client = connect(address, timeout=_CONNECT_S, set_as_default=False)
        except (OSError, ValueError, TypeError, ImportError) as error:  # as the protocol has it
            raise JointIdError(
                f"There is no Dask scheduler at {address:.200} ({error!s:.200}): check the address, as "
                "dask scheduler prints it."
            ) from error
        try:
            self._require_workers()
        except BaseException:
            self._client.close()
            raise

    def _require_workers(self) -> None:
        try:
            self._client.wait_for_workers(1, timeout=_CONNECT_S)
        except (OSError, TimeoutError) as error:
            raise JointIdError(
                f"The scheduler at {self._address} has no workers: start some with dask worker "
                f"{self._address}."
            ) from error
        try:
            versions = dict(self._client.run(_version))
        except Exception as error:  # an import on a worker can raise anything
            raise JointIdError(
                f"The workers of {self._address} cannot load jointid ({error!s:.200}): install it "
                f"there, version {__version__}."
            ) from error
        for worker, version in versions.items():
            if version != __version__:
                raise JointIdError(
                    f"The worker {worker} has jointid {version}, this computer {__version__}: install "
                    "the same version."
                )

    def run(self, jobs: Sequence[Job]) -> Generator[Done, None, None]:
        """Yield finished jobs; closing the generator cancels the others."""
        reader, todo, away = Child(WORKER, self._limits), iter(jobs), 0
        done = queue.SimpleQueue[tuple[Job, Future[Any]]]()
        try:
            while True:
                while away < _SENT_PER_THREAD * self._threads() and (job := next(todo, None)):
                    read = _read(reader, job)
                    if isinstance(read, Done):
                        yield read
                    else:
                        self._send(read, done)
                        away += 1
                if away == 0:
                    return
                with suppress(queue.Empty):
                    finished = done.get(timeout=_POLL_S)
                    away -= 1
                    yield self._received(*finished)
        finally:
            reader.stop()
            self._leave()

    def _threads(self) -> int:
        """Threads of the cluster, one or more; asked for every second."""
        if time.monotonic() - self._asked_s > _POLL_S:
            self._asked_s = time.monotonic()
            if self._client.status == "closed":
                raise self._lost_connection()
            with suppress(OSError, TimeoutError):
                self._size = max(1, sum(dict(self._client.nthreads()).values()))
        return self._size

    def _send(self, job: Job, done: queue.SimpleQueue[tuple[Job, Future[Any]]]) -> None:
        # A unique key: equal ones share a result, or its loss.
        key = f"jointid-{uuid.uuid4().hex}"
        arguments = job, self._limits, self._batch
        try:
            with dask.config.set({"distributed.admin.large-graph-warning-threshold": "1 GiB"}):
                future = self._client.submit(_analysed, *arguments, key=key, retries=2)
        except Exception as error:
            raise self._lost_connection() from error
        future.add_done_callback(lambda future: done.put((job, future)))

    def _received(self, job: Job, future: Future[Any]) -> Done:
        try:
            return Done(job, future.result())
        except KilledWorker:
            text = "All its workers were lost: the study may need more memory than they have."
        except Exception as error:
            if future.status != "error":
                raise self._lost_connection() from error
            text = f"The worker failed: {type(error).__name__}: {error!s:.300}"
        return Done(job, failed_row(job.study, job.method, LOST, text))

    def _lost_connection(self) -> JointIdError:
        return JointIdError(
            f"The connection to the scheduler at {self._address} is lost. Finished rows are kept: run "
            "the same command again when it is back."
        )

    def _leave(self) -> None:
        """End the child processes on the workers that respond."""
        with suppress(Exception):
            if self._client.status == "running":
                self._client.run(_stop_children, self._batch, on_error="ignore")
        with suppress(Exception):
            self._client.close()


def _read(reader: Child, job: Job) -> Job | Done:
    """Return the job with its study's bytes, or its result when that is known already."""
    if isinstance(job.source, bytes):
        return job
    answer, data = ask_child(reader, job, "pack")
    if "content" in answer:
        return replace(job, source=data, known="", content=answer["content"])
    return Done(job, from_plain(answer["row"]) if "row" in answer else None)


# --- on the workers

_children: dict[tuple[str, int], Child] = {}
"""Child processes by batch and thread of this worker."""


def _analysed(job: Job, limits: Limits, batch: str) -> Row | None:
    child = _children.setdefault((batch, threading.get_ident()), Child(WORKER, limits))
    return do_job(child, job).row


def _stop_children(batch: str) -> None:
    for key in [key for key in _children if key[0] == batch]:
        _children.pop(key).stop()


def _version() -> str:
    """Version of jointid where this runs."""
    return __version__
