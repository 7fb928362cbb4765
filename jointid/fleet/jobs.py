"""A study to analyse, its result, and the interface of what analyses it."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from jointid.background.child_process import Child, Ended
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


class Executor(Protocol):
    """Analyses jobs, in any order; every job is returned exactly once."""

    def run(self, jobs: Sequence[Job]) -> Generator[Done, None, None]:
        """Yield finished jobs; closing the generator cancels the others.

        Raises
        ------
        JointIdError
            When no further job of any study is possible.
        """


def do_job(child: Child, job: Job) -> Done:
    """Analyse a study in a child process, on this computer or on a cluster.

    Raises
    ------
    JointIdError
        When no process can be started.
    """
    by_path = isinstance(job.source, Path)
    request = {"do": "analyse", "path": str(job.source) if by_path else "", "content": job.content}
    answer, _ = ask_child(child, job, request, b"" if isinstance(job.source, Path) else job.source)
    return Done(job, from_plain(answer["row"]) if "row" in answer else None)


def ask_child(
    child: Child, job: Job, request: dict[str, str], body: bytes = b""
) -> tuple[dict[str, Any], bytes]:
    """Send a request about a job; the answer holds a row, "unchanged", or what was requested."""
    about = {"study": job.study, "method": job.method, "known": job.known}
    try:
        return child.ask(request | about, body)
    except Ended as ended:
        failure = TIME if ended.late else CRASH
        return {"row": to_plain(failed_row(job.study, job.method, failure, str(ended)))}, b""
