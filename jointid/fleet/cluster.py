"""Studies analysed on a Dask cluster: each travels as bytes and comes back as its row.

The files are read here, in a process that can be ended; on the workers a study is analysed by a process
of its own as well, so that what one study does to it never reaches the worker. When a worker is lost,
the scheduler gives its studies to others.
"""

from __future__ import annotations

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
from jointid.fleet.jobs import WORKER, Done, Job, asked, do_job
from jointid.fleet.row import LOST, Row, failed, from_plain
from jointid.version import __version__

_CONNECT_S = 20.0
_LOOK_S = 1.0
_AHEAD = 3
"""Studies on their way for each thread of the cluster: enough to keep it busy, little to hold."""


class _Client(Client):
    """A client that is closed by its owner, here by ``Cluster``.

    The inherited one closes itself when it is forgotten. One that never came to connect, as with an
    address without a port, then waits 40 s at the end of the program, for a loop that is over.
    """

    def __del__(self) -> None:
        pass


class Cluster:
    """The workers of a Dask scheduler.

    Parameters
    ----------
    address : str
        Such as "tcp://10.0.0.5:8786".
    limits : Limits
        What one study may take.

    Raises
    ------
    JointIdError
        When the scheduler cannot be reached, has no worker, or a worker lacks this version of jointid.
    """

    def __init__(self, address: str, limits: Limits | None = None) -> None:
        self._limits = limits or Limits()
        self._address = address
        self._batch = uuid.uuid4().hex
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
        except Exception as error:  # whatever an import over there raises
            raise JointIdError(
                f"The workers of {self._address} cannot load jointid ({error!s:.200}): install it "
                f"there, version {__version__}."
            ) from error
        for worker, version in versions.items():
            if version != __version__:
                raise JointIdError(
                    f"The worker {worker} has jointid {version}, this is {__version__}: install "
                    "the same version."
                )

    def run(self, jobs: Sequence[Job]) -> Generator[Done, None, None]:
        """Yield jobs as they are done; closing the generator gives the others up."""
        done = queue.SimpleQueue[Done | tuple[Job, Future[Any]] | Exception]()
        room, stopped = _Room(_AHEAD), threading.Event()
        reader = Child(WORKER, self._limits)

        def send() -> None:
            try:
                for job in jobs:
                    room.wait()
                    if stopped.is_set():
                        return
                    read = _read(reader, job)
                    if isinstance(read, Done):
                        done.put(read)
                        continue
                    # Its very own key: an equal one would share an earlier result, or its loss.
                    future = self._client.submit(
                        _analysed,
                        read,
                        self._limits,
                        self._batch,
                        key=f"jointid-{uuid.uuid4().hex}",
                        retries=2,
                    )
                    future.add_done_callback(lambda future, job=job: done.put((job, future)))
            except Exception as error:
                if not stopped.is_set():
                    done.put(error)
            finally:
                reader.stop()

        sender = threading.Thread(target=send, daemon=True)
        with dask.config.set({"distributed.admin.large-graph-warning-threshold": "1 GiB"}):
            sender.start()
            try:
                for _ in jobs:
                    result = self._next(done, room)
                    room.leave()
                    yield result
            finally:
                stopped.set()
                room.open()
                reader.kill()
                sender.join()
                self._leave()

    def _next(
        self, done: queue.SimpleQueue[Done | tuple[Job, Future[Any]] | Exception], room: _Room
    ) -> Done:
        """The next result; meanwhile, how many threads there are is looked up now and then."""
        looked = 0.0
        while True:
            if time.monotonic() - looked > _LOOK_S:
                looked = time.monotonic()
                with suppress(OSError, TimeoutError):
                    room.size = max(1, sum(dict(self._client.nthreads()).values()))
            try:
                result = done.get(timeout=_LOOK_S)
            except queue.Empty:
                if self._client.status == "closed":
                    raise self._gone() from None
                continue
            if isinstance(result, Exception):
                raise self._gone() from result
            if isinstance(result, Done):
                return result
            return self._received(*result)

    def _received(self, job: Job, future: Future[Any]) -> Done:
        try:
            return Done(job, future.result())
        except KilledWorker:
            text = "Every worker that it was given to was lost: it may take more memory than they have."
            return Done(job, failed(job.study, job.method, LOST, text))
        except Exception as error:
            if future.status == "error":
                text = f"The worker failed: {type(error).__name__}: {error!s:.300}"
                return Done(job, failed(job.study, job.method, LOST, text))
            raise self._gone() from error

    def _gone(self) -> JointIdError:
        return JointIdError(
            f"The connection to the scheduler at {self._address} is lost. Finished rows are kept: give "
            "the same command again when it is back."
        )

    def _leave(self) -> None:
        """End the processes on the workers, as far as they can be reached."""
        with suppress(Exception):
            if self._client.status == "running":
                self._client.run(_stop_children, self._batch, on_error="ignore")
        with suppress(Exception):
            self._client.close()


class _Room:
    """How many studies may be on their way; grows and shrinks with the cluster."""

    def __init__(self, ahead: int) -> None:
        self.size = 1
        self._ahead = ahead
        self._inside = 0
        self._open = False
        self._changed = threading.Condition()

    def wait(self) -> None:
        """Enter when there is room."""
        with self._changed:
            while not self._open and self._inside >= self._ahead * self.size:
                self._changed.wait(0.1)
            self._inside += 1

    def leave(self) -> None:
        with self._changed:
            self._inside -= 1
            self._changed.notify()

    def open(self) -> None:
        """Hold nobody back any more."""
        with self._changed:
            self._open = True
            self._changed.notify()


def _read(reader: Child, job: Job) -> Job | Done:
    """The job with its study's bytes, or what became of it already."""
    if isinstance(job.source, bytes):
        return job
    said, data = asked(reader, job, {"do": "pack", "path": str(job.source)})
    if "content" in said:
        return replace(job, source=data, known="", content=said["content"])
    return Done(job, from_plain(said["row"]) if "row" in said else None)


# --- on the workers

_children: dict[tuple[str, int], Child] = {}
"""One process for each batch and thread of this worker."""


def _analysed(job: Job, limits: Limits, batch: str) -> Row | None:
    child = _children.setdefault((batch, threading.get_ident()), Child(WORKER, limits))
    return do_job(child, job).row


def _stop_children(batch: str) -> None:
    for key in [key for key in _children if key[0] == batch]:
        _children.pop(key).stop()


def _version() -> str:
    """Version of jointid where this runs."""
    return __version__
