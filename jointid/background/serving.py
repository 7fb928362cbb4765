"""The child's side of a worker process: serve requests until stdin closes.

A request is one line of JSON on standard input, followed by as many bytes as its header states; a
response has the same form on standard output. Progress messages may precede it.
"""

import json
import math
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

Progress = Callable[..., None]
Answer = Callable[[dict[str, Any], bytes, Progress], tuple[dict[str, Any], bytes]]
"""Handler of one request: header, body and a progress callback in, header and body out."""

IDLE_S = 600.0
"""Idle time after which the process ends itself: its parent may have died silently, s."""
_WATCH_S = 1.0  # interval at which the process looks for its parent, s
GRACE_S = 10.0
"""Delay beyond the time limit after which the process ends itself if its parent has not, s."""


def serve_here(answer: Answer, memory_bytes: int) -> None:
    """Serve on this process's standard input and output.

    ``memory_bytes`` is the address space for requests beyond that of the program itself, where the
    system can limit it.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is handled by the parent
    warnings.simplefilter("ignore")
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # other output must not mix with responses
    _limit_memory(memory_bytes)
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()

    def report(*done: float | str) -> None:
        _send(answers, {"progress": done}, b"")

    _send(answers, {"ready": True}, b"")
    while True:
        _end_in(IDLE_S)
        line = sys.stdin.buffer.readline()
        if not line:
            return
        request = json.loads(line)
        _end_in(request["time_s"] + GRACE_S)
        body = sys.stdin.buffer.read(request["bytes"])
        _send(answers, {"begun": True}, b"")
        _send(answers, *answer(request, body, report))


def _send(answers: BinaryIO, header: dict[str, Any], body: bytes) -> None:
    answers.write(json.dumps(header | {"bytes": len(body)}).encode() + b"\n")
    answers.write(body)
    answers.flush()


def _end_in(time_s: float) -> None:
    """Let the system end this process after a time, even inside a call that never returns."""
    if hasattr(signal, "alarm"):
        signal.alarm(math.ceil(time_s))


def _end_with(parent: int) -> None:
    """End this process, also inside a call that never returns, soon after its parent was killed."""
    while os.getppid() == parent:
        time.sleep(_WATCH_S)
    os._exit(1)


def _limit_memory(size: int) -> None:
    try:
        import resource

        here = int(Path("/proc/self/statm").read_text("ascii").split()[0]) * os.sysconf("SC_PAGE_SIZE")
        resource.setrlimit(resource.RLIMIT_AS, (here + size, here + size))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    except (ImportError, OSError, ValueError):
        return
