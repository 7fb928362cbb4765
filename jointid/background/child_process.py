"""A process that answers what it is asked, and can be ended without losing more than one answer."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from jointid.errors import JointIdError

_BEGIN = """
import importlib, sys
sys.path.insert(0, sys.argv[1])
importlib.import_module(sys.argv[2]).main(int(sys.argv[3]))
"""
_START_S = 60.0
_LONGEST_HEADER = 64 << 20
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


@dataclass(frozen=True)
class Limits:
    """What one request may take."""

    time_s: float = 120.0
    memory_bytes: int = 4 << 30
    """Beyond what the program itself needs; kept where the system can bound it (not on Windows)."""

    def __post_init__(self) -> None:
        if not 0 < self.time_s < 1e7:
            raise JointIdError(f"time_s = {self.time_s:g} s: give a time above 0, below 10⁷ s.")
        if self.memory_bytes < 64 << 20:
            raise JointIdError(f"memory_bytes = {self.memory_bytes}: give at least {64 << 20} (64 MiB).")


class Ended(Exception):
    """The process ended over a request, or was ended."""

    def __init__(self, text: str, *, late: bool = False) -> None:
        super().__init__(text)
        self.late = late
        """Whether it was ended for the time that it took."""


class Child:
    """One process, begun when first needed and anew when a request has ended it.

    Parameters
    ----------
    module : str
        What it runs, a module with a ``main`` that serves; see ``serving.py``.
    limits : Limits
    """

    def __init__(self, module: str, limits: Limits) -> None:
        self._module = module
        self._limits = limits
        self._process: subprocess.Popen[bytes] | None = None
        self._errors: IO[bytes] | None = None
        self._stopped = False

    @property
    def runs(self) -> bool:
        """Whether the process is there, so that it answers without having to begin."""
        return self._process is not None and self._process.poll() is None

    def begin(self) -> None:
        """Begin the process, if it is not there.

        Raises
        ------
        JointIdError
            When no process can be started.
        """
        self._running()

    def ask(
        self,
        request: dict[str, Any],
        body: bytes = b"",
        progress: Callable[..., object] | None = None,
    ) -> tuple[dict[str, Any], bytes]:
        """Send a request and return its answer.

        Parameters
        ----------
        request : dict
            As JSON can hold it.
        body : bytes
        progress : callable, optional
            Called with the fraction done and what else the process tells. What it raises ends the
            process.

        Raises
        ------
        Ended
            When the process ended over it, or was ended for the time it took.
        JointIdError
            When no process can be started.
        """
        for attempt in range(2):
            process = self._running()
            late = threading.Event()

            def end(process: subprocess.Popen[bytes] = process, late: threading.Event = late) -> None:
                late.set()
                process.kill()

            timer = threading.Timer(self._limits.time_s, end)
            timer.daemon = True
            timer.start()
            begun = False
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
                    raise  # of ``progress``, which has ended it
                with suppress(subprocess.TimeoutExpired):
                    process.wait(1.0)  # its own exit code tells more than being ended
                code = self._end()
                if late.is_set():
                    text = f"It took more than {self._limits.time_s:g} s and was ended."
                    raise Ended(text, late=True) from None
                if begun or attempt or self._stopped:
                    raise Ended(f"It ended the process that worked on it ({_why(code)}).") from None
                # The process was idle too long, or somebody ended it: the request is not to blame.
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
                except BaseException:  # nobody waits for the answer any more
                    self._end()
                    raise

    def kill(self) -> None:
        """End the process from another thread; ``ask`` then raises ``Ended``."""
        self._stopped = True
        if (process := self._process) is not None:
            process.kill()

    def stop(self) -> None:
        """End the process."""
        self._stopped = True
        self._end()

    def _running(self) -> subprocess.Popen[bytes]:
        if self._process is not None and self.runs:
            return self._process
        self._end()
        command = [sys.executable, "-P", "-c", _BEGIN, str(Path(__file__).parents[2])]
        try:
            self._errors = tempfile.TemporaryFile()  # noqa: SIM115  # lives as long as the process
            self._process = subprocess.Popen(
                [*command, self._module, str(self._limits.memory_bytes)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                env=os.environ | dict.fromkeys(_THREADS, "1"),
                start_new_session=True,  # Ctrl-C in a terminal reaches the command alone
            )
        except OSError as error:
            raise JointIdError(
                f"A process of its own cannot be started: {error!s:.200}. Free memory, or take "
                "fewer workers."
            ) from error
        process = self._process
        timer = threading.Timer(_START_S, process.kill)
        timer.daemon = True
        timer.start()
        try:
            _received(process)
        except (OSError, ValueError, EOFError):
            with suppress(subprocess.TimeoutExpired):
                process.wait(1.0)
            said = self._last_words()
            code = self._end()
            if self._stopped:
                raise Ended("It was stopped.") from None
            raise JointIdError(
                f"A process of its own ended as it began ({_why(code)}). {said}"
            ) from None
        finally:
            timer.cancel()
        if self._stopped:
            self._end()
            raise Ended("It was stopped.")
        return process

    def _last_words(self) -> str:
        if self._errors is None:
            return ""
        with suppress(OSError, ValueError):
            self._errors.seek(0, os.SEEK_END)
            self._errors.seek(max(0, self._errors.tell() - 500))
            return " ".join(self._errors.read().decode("utf-8", "replace").split())
        return ""

    def _end(self) -> int:
        process, self._process = self._process, None
        code = 0
        if process is not None:
            process.kill()
            code = process.wait()
            for pipe in (process.stdin, process.stdout):
                if pipe is not None:
                    with suppress(OSError):  # what was still to be written is of no use
                        pipe.close()
        if self._errors is not None:
            self._errors.close()
            self._errors = None
        return code


def _received(process: subprocess.Popen[bytes]) -> tuple[dict[str, Any], bytes]:
    assert process.stdout is not None
    line = process.stdout.readline(_LONGEST_HEADER)
    if not line:
        raise EOFError
    header: dict[str, Any] = json.loads(line)
    body = process.stdout.read(header["bytes"])
    if len(body) != header["bytes"]:
        raise EOFError
    return header, body


def _why(code: int) -> str:
    if code >= 0:
        return f"exit code {code}"
    with suppress(ValueError):
        return f"signal {signal.Signals(-code).name}"
    return f"signal {-code}"
