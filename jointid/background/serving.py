"""The other side of a process of its own: it answers requests until there are none.

A request is a line of JSON on standard input, followed by as many bytes as it says; so is an answer, on
standard output. Before it, there may be lines that tell how much is done.
"""

from __future__ import annotations

import json
import math
import os
import signal
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

from jointid.version import __version__

Progress = Callable[..., None]
Answer = Callable[[dict[str, Any], bytes, Progress], tuple[dict[str, Any], bytes]]
"""From a request with its bytes, and a function that tells how far it is, to its answer."""

IDLE_S = 600.0
"""How long the process waits for a request before it ends: its owner may have ended without a word."""
GRACE_S = 10.0
"""How much later than its owner it ends itself over a request that takes too long."""


def serve_here(answer: Answer, memory_bytes: int) -> None:
    """Serve on this process's standard input and output.

    Parameters
    ----------
    answer : callable
    memory_bytes : int
        What requests may take beyond the program itself, where the system can bound it.
    """
    if hasattr(signal, "SIGINT"):
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the owner's
    warnings.simplefilter("ignore")
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # nothing else may write among the answers
    _limit_memory(memory_bytes)
    serve(answer, sys.stdin.buffer, answers)


def serve(answer: Answer, requests: BinaryIO, answers: BinaryIO) -> None:
    """Answer requests until there are none."""

    def tell(*how_far: float | str) -> None:
        _send(answers, {"progress": how_far}, b"")

    _send(answers, {"ready": __version__}, b"")
    while True:
        _end_in(IDLE_S)
        line = requests.readline()
        if not line:
            return
        request = json.loads(line)
        _end_in(request["time_s"] + GRACE_S)
        body = requests.read(request["bytes"])
        _send(answers, {"begun": True}, b"")
        _send(answers, *answer(request, body, tell))


def _send(answers: BinaryIO, header: dict[str, Any], body: bytes) -> None:
    answers.write(json.dumps(header | {"bytes": len(body)}).encode() + b"\n")
    answers.write(body)
    answers.flush()


def _end_in(time_s: float) -> None:
    """Have the system end this process, even in the middle of a call that never returns."""
    if hasattr(signal, "alarm"):
        signal.alarm(math.ceil(time_s))


def _limit_memory(size: int) -> None:
    try:
        import resource

        here = int(Path("/proc/self/statm").read_text("ascii").split()[0]) * os.sysconf("SC_PAGE_SIZE")
        resource.setrlimit(resource.RLIMIT_AS, (here + size, here + size))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    except (ImportError, OSError, ValueError):
        return
