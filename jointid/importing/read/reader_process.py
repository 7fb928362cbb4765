"""Binary logs are read in a process of their own, with bounded memory and time."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np

from jointid.errors import JointIdError
from jointid.importing.columns.log_table import LogColumn, LogTable
from jointid.importing.read.worker import WORDS

MEMORY_BYTES = 3 << 30
"""What the reading process may take, address space; a file of 256 MiB needs half of it."""
TIME_S = 120.0
"""How long one file may take, s."""

_LONGEST_HEADER = 16 << 20
# The package's front door loads all of the method, which takes a second and is not needed here.
_BEGIN = """
import sys, types
package, parent = types.ModuleType("jointid.importing"), types.ModuleType("jointid")
parent.__path__, package.__path__ = [sys.argv[1]], [sys.argv[1] + "/importing"]
sys.modules.update({"jointid": parent, "jointid.importing": package})
from jointid.importing.read import worker
worker.limit_memory(int(sys.argv[2]))
worker.serve(sys.stdin.buffer, sys.stdout.buffer)
"""


class SeparateReader:
    """The reading process: begun when first needed, and anew when a file has ended it.

    Parameters
    ----------
    time_s : float, optional
        How long one file may take, s.
    """

    def __init__(self, time_s: float = TIME_S) -> None:
        self._time_s = time_s
        self._process: subprocess.Popen[bytes] | None = None

    def read(self, kind: str, name: str, path: Path) -> tuple[LogTable, ...]:
        """Read one file.

        Parameters
        ----------
        kind : str
            As in ``jointid.importing.read.file_types``, not "text".
        name : str
            For messages.
        path : Path
            Where it lies.

        Raises
        ------
        JointIdError
            When it is no log, ends the process, or takes too much memory or time.
        """
        process = self._started()
        assert process.stdin is not None
        assert process.stdout is not None
        late = threading.Event()

        def end() -> None:
            late.set()
            process.kill()

        timer = threading.Timer(self._time_s, end)
        timer.start()
        try:
            request = {"kind": kind, "name": name, "path": str(path)}
            process.stdin.write(json.dumps(request).encode() + b"\n")
            process.stdin.flush()
            header = json.loads(process.stdout.readline(_LONGEST_HEADER))
            if "error" in header:
                raise JointIdError(header["error"])
            return tuple(_received(process, table) for table in header["tables"])
        except JointIdError:
            raise
        except (OSError, ValueError, EOFError) as error:
            self.stop()
            if late.is_set():
                fault = f"reading it took more than {self._time_s:g} s"
            else:
                fault = "its content stops the reader"
            raise JointIdError(
                f"{name} cannot be read as {WORDS[kind]} ({fault}): it is damaged. Export the log again."
            ) from error
        finally:
            timer.cancel()

    def _started(self) -> subprocess.Popen[bytes]:
        if self._process is None or self._process.poll() is not None:
            environment = {
                **os.environ,
                # Threads of numerical libraries reserve address space that nothing here needs.
                "OMP_NUM_THREADS": "1",
                "OPENBLAS_NUM_THREADS": "1",
                # HDF5 loads no plugin for a filter that a file asks for.
                "HDF5_PLUGIN_PRELOAD": "::",
            }
            try:
                self._process = subprocess.Popen(
                    [
                        sys.executable,
                        "-P",
                        "-c",
                        _BEGIN,
                        str(Path(__file__).parents[2]),
                        str(MEMORY_BYTES),
                    ],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL,
                    env=environment,
                )
            except OSError as error:
                raise JointIdError(
                    f"The process that reads binary logs cannot be started ({error!s:.200}). "
                    "Export the log as CSV."
                ) from error
        return self._process

    def stop(self) -> None:
        """End the process and close its pipes."""
        process, self._process = self._process, None
        if process is None:
            return
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                try:
                    pipe.close()
                except OSError:
                    continue  # what was still to be written is of no use


def _received(process: subprocess.Popen[bytes], header: dict[str, object]) -> LogTable:
    assert process.stdout is not None
    columns = []
    rows = int(str(header["rows"]))
    described = header["columns"]
    notes = header["notes"]
    assert isinstance(described, list)
    assert isinstance(notes, list)
    for name, unit, where in described:
        raw = process.stdout.read(8 * rows)
        if len(raw) != 8 * rows:
            raise EOFError
        columns.append(LogColumn(name, np.frombuffer(raw, np.float64), unit, where))
    return LogTable(
        str(header["name"]),
        tuple(columns),
        tuple(notes),
        int(str(header["first_row"])),
        str(header["row_word"]),
    )
