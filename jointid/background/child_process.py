"""A worker process with memory and time limits; a crash or hang affects one request only."""

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from jointid.errors import JointIdError

_PROGRAM = """
import importlib, sys
path, module, memory_bytes, *preloaded = sys.argv[1:]
sys.path.insert(0, path)
for name in preloaded:
    importlib.import_module(name)
importlib.import_module(module).main(int(memory_bytes))
"""
_START_LIMIT_S = 60.0
_MAX_HEADER_BYTES = 64 << 20
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


@dataclass(frozen=True)
class Limits:
    """Limits for one request."""

    time_s: float = 120.0
    memory_bytes: int = 4 << 30
    """Address space beyond that of the program itself; enforced except on Windows."""

    def __post_init__(self) -> None:
        if not 0 < self.time_s < 1e7:
            raise JointIdError(f"time_s = {self.time_s:g} s: give a time above 0 and below 10⁷ s.")
        if self.memory_bytes < 64 << 20:
            raise JointIdError(f"memory_bytes = {self.memory_bytes}: give at least {64 << 20} (64 MiB).")


class Ended(Exception):
    """The process crashed during a request, or was killed."""

    def __init__(self, text: str, *, late: bool = False) -> None:
        super().__init__(text)
        self.late = late
        """Whether the time limit was exceeded."""


class Child:
    """One worker process, started lazily and restarted after a crash.

    ``main`` of its module serves requests; see ``serving.py``. It imports ``preload`` at its start, so
    that the first request need not wait for them.
    """

    def __init__(self, module: str, limits: Limits, preload: Sequence[str] = ()) -> None:
        self._arguments = [module, str(limits.memory_bytes), *preload]
        self._limits = limits
        self._process: subprocess.Popen[bytes] | None = None
        self._errors: IO[bytes] | None = None
        self._stopped = False

    @property
    def is_running(self) -> bool:
        """Whether the process is up, so that a request need not wait for its start."""
        return self._process is not None and self._process.poll() is None

    def ask(
        self, request: dict[str, Any], body: bytes = b"", progress: Callable[..., object] | None = None
    ) -> tuple[dict[str, Any], bytes]:
        """Send a request, JSON and bytes, and return its response.

        ``progress`` is called with the fraction done, and any text the process adds; an exception it
        raises kills the process. Raises Ended when the process crashed or exceeded the time limit;
        JointIdError when no process can be started.
        """
        for attempt in range(2):
            process = self.start()
            late, begun = threading.Event(), False
            timer = _kill_after(self._limits.time_s, process, late)
            try:
                header = request | {"bytes": len(body), "time_s": self._limits.time_s}
                assert process.stdin is not None
                process.stdin.write(json.dumps(header).encode() + b"\n")
                process.stdin.write(body)
                process.stdin.flush()
                begun = bool(_received(process)[0]["begun"])
                return self._answer(process, progress)
            except (OSError, ValueError, EOFError):
                if self._process is not process:
                    raise  # by ``progress``; the process is killed already
                code = self._end(1.0)
                if late.is_set():
                    text = f"It took more than {self._limits.time_s:g} s and was stopped."
                    raise Ended(text, late=True) from None
                if begun or attempt or self._stopped:
                    raise Ended(f"It crashed the worker process ({_exit_reason(code)}).") from None
                # It had idled out or was killed from outside: the request is tried once more.
            finally:
                timer.cancel()
        raise AssertionError

    def _answer(
        self, process: subprocess.Popen[bytes], progress: Callable[..., object] | None
    ) -> tuple[dict[str, Any], bytes]:
        while True:
            header, body = _received(process)
            if "progress" not in header:
                return header, body
            if progress is not None:
                try:
                    progress(*header["progress"])
                except BaseException:  # the caller no longer waits
                    self._end()
                    raise

    def kill(self) -> None:
        """Kill the process from another thread; ``ask`` then raises ``Ended``."""
        self._stopped = True
        if (process := self._process) is not None:
            process.kill()

    def stop(self) -> None:
        """End the process."""
        self._stopped = True
        self._end()

    def start(self) -> subprocess.Popen[bytes]:
        """Start the process unless it runs. Raises JointIdError when no process can be started."""
        if self._process is not None and self.is_running:
            return self._process
        self._end()
        command = [sys.executable, "-P", "-c", _PROGRAM, str(Path(__file__).parents[2])]
        try:
            self._errors = tempfile.TemporaryFile()  # noqa: SIM115  # lives as long as the process
            self._process = subprocess.Popen(
                [*command, *self._arguments],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                env=os.environ | dict.fromkeys(_THREADS, "1"),
                # Ctrl-C in a terminal reaches the parent only. Not a session of its own: Linux shares
                # the processors among sessions, and priorities count only within one.
                process_group=0,
            )
        except OSError as error:
            raise JointIdError(
                f"A worker process cannot be started: {error!s:.200}. Free memory, or use fewer workers."
            ) from error
        process = self._process
        timer = _kill_after(_START_LIMIT_S, process)
        try:
            _received(process)
        except (OSError, ValueError, EOFError):
            said = self._error_output()
            code = self._end(1.0)
            if self._stopped:
                raise Ended("It was stopped.") from None
            raise JointIdError(
                f"A worker process did not start ({_exit_reason(code)}). {said} Free memory, or install "
                "jointid again."
            ) from None
        finally:
            timer.cancel()
        if self._stopped:
            self._end()
            raise Ended("It was stopped.")
        return process

    def _error_output(self) -> str:
        if self._errors is not None:
            with suppress(OSError, ValueError):  # closed by ``stop`` in another thread
                self._errors.seek(0)
                return " ".join(self._errors.read()[-500:].decode("utf-8", "replace").split())
        return ""

    def _end(self, patience_s: float = 0.0) -> int:
        """End the process, after a wait for its own exit code, which says more than SIGKILL."""
        process, self._process = self._process, None
        code = 0
        if process is not None:
            with suppress(subprocess.TimeoutExpired):
                process.wait(patience_s)
            process.kill()
            code = process.wait()
            for pipe in (process.stdin, process.stdout):
                if pipe is not None:
                    with suppress(OSError):  # unsent data is of no use
                        pipe.close()
        if self._errors is not None:
            self._errors.close()
            self._errors = None
        return code


def _kill_after(
    time_s: float, process: subprocess.Popen[bytes], late: threading.Event | None = None
) -> threading.Timer:
    """Start a timer that kills a process and sets ``late``."""

    def kill() -> None:
        if late is not None:
            late.set()
        process.kill()

    timer = threading.Timer(time_s, kill)
    timer.daemon = True
    timer.start()
    return timer


def _received(process: subprocess.Popen[bytes]) -> tuple[dict[str, Any], bytes]:
    assert process.stdout is not None
    line = process.stdout.readline(_MAX_HEADER_BYTES)
    if not line:
        raise EOFError
    header: dict[str, Any] = json.loads(line)
    body = process.stdout.read(header["bytes"])
    if len(body) != header["bytes"]:
        raise EOFError
    return header, body


def _exit_reason(code: int) -> str:
    if code >= 0:
        return f"exit code {code}"
    with suppress(ValueError):
        return f"signal {signal.Signals(-code).name}"
    return f"signal {-code}"
