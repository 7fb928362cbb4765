"""Isolated worker process: a crash or hang affects one study only."""

import json
import time
from functools import partial
from pathlib import Path
from typing import Any

from jointid.analysis import analyse, answer_of
from jointid.background.serving import Progress, serve_here
from jointid.errors import JointIdError
from jointid.files.study_files import load_study
from jointid.fleet.row import FAULT, MEMORY, REFUSED, Row, failed_row, row_of, to_plain
from jointid.fleet.studies import content_digest, packed


def study_row(
    source: Path | bytes, study: str, method: str, known: str = "", content: str = ""
) -> Row | None:
    """Analyse one study; every failure becomes a row. None when its files are unchanged.

    ``source`` is a folder or .zip by its path, or a zip, and ``study`` its name in the table; ``known``
    the digest of the files of an existing row, ``content`` that of the files ``source`` was made from,
    by default of ``source``.
    """
    begin = time.perf_counter()
    try:
        content = content or content_digest(source)
        if content == known:
            return None
        analysis = answer_of(load_study(source), partial(analyse, method=method))
        took = time.perf_counter() - begin
        return row_of(analysis, study=study, content=content, method=method, time_s=took)
    except Exception as error:
        return _failed(study, method, error, content, time.perf_counter() - begin)


def _failed(study: str, method: str, error: Exception, content: str = "", time_s: float = 0.0) -> Row:
    """Row of a study with the kind and the message of its failure."""
    failure, text = REFUSED, str(error)
    if isinstance(error, MemoryError):
        failure = MEMORY
        text = "The study needs more memory than the limit: shorten its records, or raise --memory."
    elif isinstance(error, OSError):
        place = error.filename or "The study"
        text = f"{place}: {error.strerror or error}. Give a study's folder, or that folder as .zip."
    elif not isinstance(error, JointIdError):
        kind, failure = type(error).__name__, FAULT
        text = f"Internal error, {kind}: {error!s:.300} This is a bug in jointid."
    return failed_row(study, method, failure, text, content=content, time_s=time_s)


def answer(request: dict[str, Any], body: bytes, _: Progress) -> tuple[dict[str, Any], bytes]:
    """Answer one request.

    "analyse" takes a study by its ``path`` or as the body, "pack" reads its files to send them
    elsewhere, "read" takes a table of results as the body.
    """
    what = request["do"]
    if what == "read":
        from jointid.fleet.table import read_fleet

        try:
            return {}, json.dumps([to_plain(row) for row in read_fleet(body)]).encode()
        except JointIdError as error:
            return {"error": str(error)}, b""
    study, method, known = request["study"], request["method"], request["known"]
    if what == "pack":
        try:
            content = content_digest(Path(request["path"]))
            if content == known:
                return {"unchanged": True}, b""
            return {"content": content}, packed(Path(request["path"]))
        except Exception as error:
            return {"row": to_plain(_failed(study, method, error))}, b""
    row = study_row(
        Path(request["path"]) if request["path"] else body, study, method, known, request["content"]
    )
    return ({"unchanged": True} if row is None else {"row": to_plain(row)}), b""


def main(memory_bytes: int) -> None:
    """Serve on standard input and output."""
    serve_here(answer, memory_bytes)
