"""The process that analyses studies: whatever one of them does to it, the batch lives on.

A request is a line of JSON on standard input, followed by as many bytes as it says; so is an answer, on
standard output.
"""

from __future__ import annotations

import json
import math
import os
import signal
import sys
import time
import warnings
from pathlib import Path
from typing import Any, BinaryIO

from jointid.errors import JointIdError
from jointid.exporting.identification import software_version
from jointid.fleet.content import content_digest, packed
from jointid.fleet.row import FAULT, MEMORY, REFUSED, Row, failed, row_of, to_plain
from jointid.study import analyse
from jointid.study_files import load_study

IDLE_S = 600.0
"""How long the process waits for a request before it ends: its owner may have ended without a word."""
GRACE_S = 10.0
"""How much later than its owner it ends itself over a request that takes too long."""


def study_row(
    source: Path | bytes, study: str, method: str, known: str = "", content: str = ""
) -> Row | None:
    """Analyse one study, whatever it is.

    Parameters
    ----------
    source : Path or bytes
        A folder or .zip by its path, or a zip.
    study : str
        What the row calls it.
    method : str
        Estimator, one of ``jointid.elasticity.METHODS``.
    known : str
        Digest of files that have their row already.
    content : str
        Digest of the files that ``source`` was made from; left out: that of ``source``.

    Returns
    -------
    Row or None
        None when the files are the known ones.
    """
    begin = time.perf_counter()
    try:
        content = content or content_digest(source)
        if content == known:
            return None
        analysis = analyse(load_study(source), method=method)
        took = time.perf_counter() - begin
        return row_of(analysis, study=study, content=content, method=method, time_s=took)
    except (Exception, MemoryError) as error:
        failure, text = _said(error)
        took = time.perf_counter() - begin
        return failed(study, method, failure, text, content=content, time_s=took)


def _said(error: BaseException) -> tuple[str, str]:
    """What kind of failure it is, and a message."""
    if isinstance(error, JointIdError):
        return REFUSED, str(error)
    if isinstance(error, MemoryError):
        return (
            MEMORY,
            "The study needs more memory than it may take: shorten its records, or allow more.",
        )
    if isinstance(error, OSError):
        return REFUSED, (
            f"{error.filename or 'The study'}: {error.strerror or error}. Give a study's folder, or "
            "that folder as .zip."
        )
    return FAULT, f"Internal error, {type(error).__name__}: {error!s:.300} This is a fault of jointid."


def answer(request: dict[str, Any], body: bytes) -> tuple[dict[str, Any], bytes]:
    """Answer one request.

    "analyse" takes a study by its ``path`` or as the body, "pack" reads its files to send them
    elsewhere, "read" takes a table of results as the body.
    """
    what = request["do"]
    if what == "read":
        from jointid.fleet.table import read_rows

        try:
            return {}, json.dumps([to_plain(row) for row in read_rows(body)]).encode()
        except JointIdError as error:
            return {"error": str(error)}, b""
    study, method, known = request["study"], request["method"], request["known"]
    if what == "pack":
        try:
            content = content_digest(Path(request["path"]))
            if content == known:
                return {"unchanged": True}, b""
            return {"content": content}, packed(Path(request["path"]))
        except (Exception, MemoryError) as error:
            failure, text = _said(error)
            return {"row": to_plain(failed(study, method, failure, text))}, b""
    row = study_row(
        Path(request["path"]) if request["path"] else body, study, method, known, request["content"]
    )
    return ({"unchanged": True} if row is None else {"row": to_plain(row)}), b""


def serve(requests: BinaryIO, answers: BinaryIO) -> None:
    """Answer requests until there are none."""
    _send(answers, {"ready": software_version()}, b"")
    while True:
        _end_in(IDLE_S)
        line = requests.readline()
        if not line:
            return
        request = json.loads(line)
        _end_in(request["time_s"] + GRACE_S)
        body = requests.read(request["bytes"])
        _send(answers, {"begun": True}, b"")
        _send(answers, *answer(request, body))


def _send(answers: BinaryIO, header: dict[str, Any], body: bytes) -> None:
    answers.write(json.dumps(header | {"bytes": len(body)}).encode() + b"\n" + body)
    answers.flush()


def _end_in(time_s: float) -> None:
    """Have the system end this process, even in the middle of a call that never returns."""
    if hasattr(signal, "alarm"):
        signal.alarm(math.ceil(time_s))


def _limit_memory(size: int) -> None:
    """Bound what studies may take beyond the program itself, where the system can."""
    try:
        import resource

        here = int(Path("/proc/self/statm").read_text("ascii").split()[0]) * os.sysconf("SC_PAGE_SIZE")
        resource.setrlimit(resource.RLIMIT_AS, (here + size, here + size))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    except (ImportError, OSError, ValueError):
        return


def main(memory_bytes: int) -> None:
    """Serve on standard input and output."""
    if hasattr(signal, "SIGINT"):
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the owner's
    warnings.simplefilter("ignore")
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # nothing else may write among the answers
    _limit_memory(memory_bytes)
    serve(sys.stdin.buffer, answers)
