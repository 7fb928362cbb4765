"""What is to be done, who can do it, and what comes back."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from jointid.background.child_process import Child, Ended
from jointid.fleet.row import CRASH, TIME, Row, failed, from_plain, to_plain

WORKER = "jointid.fleet.worker"
"""What the processes run that analyse."""


@dataclass(frozen=True)
class Job:
    """A study to analyse."""

    study: str
    """What its row calls it."""
    source: Path | bytes
    """A folder or .zip by its path, or a zip."""
    method: str = "auto"
    known: str = ""
    """Digest of files that have their row already."""
    content: str = ""
    """Digest of the files that ``source`` was made from; left out: that of ``source``."""


@dataclass(frozen=True)
class Done:
    """A job that is done."""

    job: Job
    row: Row | None
    """None: its files are the known ones."""


class Executor(Protocol):
    """Something that does jobs, in whatever order; every job comes back exactly once."""

    def run(self, jobs: Sequence[Job]) -> Generator[Done, None, None]:
        """Yield jobs as they are done; closing the generator gives the others up.

        Raises
        ------
        JointIdError
            When no job can be done any more, whatever the study.
        """


def do_job(child: Child, job: Job) -> Done:
    """Have a process analyse a study: the way from study to row, on this computer and on a cluster.

    Raises
    ------
    JointIdError
        When no process can be started.
    """
    by_path = isinstance(job.source, Path)
    request = {"do": "analyse", "path": str(job.source) if by_path else "", "content": job.content}
    said, _ = asked(child, job, request, b"" if isinstance(job.source, Path) else job.source)
    return Done(job, from_plain(said["row"]) if "row" in said else None)


def asked(
    child: Child, job: Job, request: dict[str, str], body: bytes = b""
) -> tuple[dict[str, Any], bytes]:
    """Ask about a job; the answer holds a row, or "unchanged", or what else was asked for."""
    about = {"study": job.study, "method": job.method, "known": job.known}
    try:
        return child.ask(request | about, body)
    except Ended as ended:
        failure = TIME if ended.late else CRASH
        return {"row": to_plain(failed(job.study, job.method, failure, str(ended)))}, b""
