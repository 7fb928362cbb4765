"""The whole batch: what is left to do is done, every row is kept at once, one table comes out."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

from jointid.background.child_process import Limits as Limits
from jointid.errors import JointIdError
from jointid.estimation.elasticity import METHODS
from jointid.fleet.jobs import Executor, Job
from jointid.fleet.journal import Journal
from jointid.fleet.local import Local
from jointid.fleet.row import Row
from jointid.fleet.studies import find_studies, shown
from jointid.fleet.table import read_fleet, write_rows
from jointid.version import __version__


@dataclass(frozen=True)
class Progress:
    """How far a batch has come."""

    studies: int
    """How many there are."""
    done: int
    """How many have their row, those from an earlier run included."""
    skipped: int
    """How many had their row from an earlier run."""
    failed: int
    """How many of the rows hold an error."""
    time_s: float
    """Since the batch began, s."""
    last: Row | None = None
    """The row that has just been added; None at the beginning."""


@dataclass(frozen=True)
class Summary:
    """What came out of a batch."""

    out: Path
    """The table of results."""
    studies: int
    """How many studies were meant."""
    skipped: int
    """How many of them had their row from an earlier run."""
    failures: tuple[Row, ...]
    """Rows of these studies that hold an error, in the order of the table."""
    verdicts: Mapping[str, int]
    """How many answers have which verdict: "good", "warning", "problem"."""
    kept: int
    """Rows of other studies, which were in the table before and stay."""
    time_s: float
    """How long it took, s."""

    @property
    def good(self) -> int:
        """How many of the studies have an answer."""
        return self.studies - len(self.failures)


def journal_path(out: Path) -> Path:
    """Return where finished rows stand until the table is complete."""
    return out.with_name(out.name + ".journal")


def analyse_fleet(
    studies: Iterable[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    method: str = "auto",
    workers: int | None = None,
    scheduler: str | None = None,
    limits: Limits | None = None,
    fresh: bool = False,
    progress: Callable[[Progress], None] | None = None,
) -> Summary:
    """Analyse many studies into one Parquet table, a row per study; go on where an earlier run stopped.

    A study that cannot be read, takes too long or ends its process becomes a row with its error, and
    the others go on. A row from an earlier run is taken over when path, files, method and version are
    the same, unless it tells of time, memory or a process that ended: that is tried again. However the
    batch ends, finished rows stay in a journal beside ``out``; the same call goes on from there.

    Parameters
    ----------
    studies : iterable of path
        Folders, .zip files, patterns, folders of studies; see ``find_studies``.
    out : path
        The table, sorted by the order of the studies. Rows of other studies that are in it already
        stay, after those.
    method : str, default "auto"
        Estimator, one of ``jointid.estimation.elasticity.METHODS``.
    workers : int, optional
        Processes of this computer; left out: as many as it has cores.
    scheduler : str, optional
        Address of a Dask scheduler, such as "tcp://10.0.0.5:8786", whose workers take the studies
        instead. Studies are sent as bytes, so workers need not see their paths.
    limits : Limits, optional
        What one study may take.
    fresh : bool, default False
        Analyse everything anew, and drop what ``out`` and its journal hold.
    progress : callable, optional
        Called with a ``Progress`` at the beginning and after every row.

    Raises
    ------
    JointIdError
        When no study is meant, ``out`` is something else than a fleet's table or cannot be written,
        another batch writes it, or the cluster cannot be reached.
    """
    if method not in METHODS:
        raise JointIdError(f'method = "{method:.60}" is not known. Methods: {", ".join(METHODS)}.')
    if workers is not None and scheduler is not None:
        raise JointIdError("workers are of this computer, a scheduler has its own: give one of them.")
    begin, target = time.perf_counter(), Path(os.path.abspath(out))
    meant = find_studies(studies)
    if not target.parent.is_dir():
        raise JointIdError(f"{target.parent} is not a folder: make it first, or choose another path.")
    with closing(Journal(journal_path(target))) as journal:
        before = _rows_before(target, journal, fresh)
        jobs = [_job(path, method, before.get(shown(path))) for path in meant]
        rows: dict[str, Row] = {}
        state = Progress(len(jobs), 0, 0, 0, 0.0)

        def tell(row: Row | None, *, skipped: bool = False) -> None:
            nonlocal state
            state = replace(
                state,
                done=len(rows),
                skipped=state.skipped + skipped,
                failed=state.failed + (row is not None and not row.is_good),
                time_s=time.perf_counter() - begin,
                last=row,
            )
            if progress is not None:
                progress(state)

        tell(None)
        executor = _executor(workers, scheduler, limits or Limits())
        with closing(executor.run(jobs)) as finished:
            for done in finished:
                row = done.row
                if row is None:
                    row = before[done.job.study]
                else:
                    journal.add(row)
                rows[done.job.study] = row
                tell(row, skipped=done.row is None)
        here = [rows[job.study] for job in jobs]
        others = [row for study, row in before.items() if study not in rows]
        write_rows(target, [*here, *others])
        journal.remove()
    return Summary(
        out=target,
        studies=len(here),
        skipped=state.skipped,
        failures=tuple(row for row in here if not row.is_good),
        verdicts={
            level: sum(row.verdict == level for row in here) for level in ("good", "warning", "problem")
        },
        kept=len(others),
        time_s=time.perf_counter() - begin,
    )


def _executor(workers: int | None, scheduler: str | None, limits: Limits) -> Executor:
    if scheduler is not None:
        from jointid.fleet.cluster import Cluster

        return Cluster(scheduler, limits)
    return Local(_cores() if workers is None else workers, limits)


def _cores() -> int:
    """How many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _rows_before(target: Path, journal: Journal, fresh: bool) -> dict[str, Row]:
    """Rows by study: of the table, then of the journal, the later ones in place of the earlier."""
    in_table: tuple[Row, ...] = ()
    if target.exists():
        try:
            in_table = read_fleet(target)
        except JointIdError as error:
            raise JointIdError(
                f"{error} It is not overwritten: choose another file for the results."
            ) from error
    if fresh:
        journal.clear()
        return {}
    return {row.study: row for row in (*in_table, *journal.rows)}


def _job(path: Path, method: str, row: Row | None) -> Job:
    same = row is not None and row.is_final and (row.method, row.version) == (method, __version__)
    return Job(shown(path), path, method, row.content if row is not None and same else "")
