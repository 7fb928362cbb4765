"""A batch: analyse the new and changed studies, journal every row, write one table."""

import os
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from jointid.background.child_process import Limits as Limits
from jointid.errors import JointIdError
from jointid.estimation.identify_elasticity import require_method
from jointid.files.application import __version__
from jointid.files.atomic_write import require_folder, write_file
from jointid.fleet.jobs import Job, Local
from jointid.fleet.journal import Journal
from jointid.fleet.row import Row
from jointid.fleet.studies import find_studies, path_text
from jointid.fleet.table import read_fleet, to_parquet
from jointid.wording import counted

if TYPE_CHECKING:
    from jointid.fleet.cluster import Cluster


@dataclass(frozen=True)
class Progress:
    """Progress of a batch."""

    studies: int
    """Number of studies."""
    done: int
    """Studies with a row, from an earlier run too."""
    skipped: int
    """Studies with a row from an earlier run."""
    failed: int
    """Rows with an error."""
    time_s: float
    """Elapsed time, s."""

    @property
    def text(self) -> str:
        """Progress in words, with rate and remaining time once a study is analysed."""
        text = f"{self.done} of {counted(self.studies, 'study')}, {self.failed} failed"
        if self.done == self.skipped or not self.time_s:
            return text
        rate = (self.done - self.skipped) / self.time_s
        left = (self.studies - self.done) / rate
        return f"{text}, {rate:.3g} per second, about {left:.0f} s left"


@dataclass(frozen=True)
class Summary:
    """Result of a batch."""

    out: Path
    """The table of results."""
    studies: int
    """Number of studies."""
    skipped: int
    """Studies with a row from an earlier run."""
    failures: tuple[Row, ...]
    """Rows with an error, in the order of the table."""
    verdicts: Mapping[str, int]
    """Number of answers by verdict: "good", "warning", "problem"."""
    kept: int
    """Earlier rows of other studies, kept in the table."""
    time_s: float
    """Elapsed time, s."""

    @property
    def good(self) -> int:
        """Number of studies with an answer."""
        return self.studies - len(self.failures)

    @property
    def rate(self) -> float:
        """Studies analysed per second."""
        return (self.studies - self.skipped) / self.time_s if self.time_s > 0 else 0.0


def journal_path(out: Path) -> Path:
    """Return the path of the journal, which holds finished rows until the table is complete."""
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
    """Analyse many studies into one Parquet table, a row per study; resume an earlier run.

    A study that cannot be read, takes too long or ends its process becomes a row with its error; the
    others continue. A row from an earlier run is reused when path, files, method and version are equal,
    unless it reports time, memory or an ended process. A journal beside ``out`` keeps the finished rows
    of an interrupted batch; the same call resumes it.

    Parameters
    ----------
    studies : iterable of path
        Folders, .zip files, patterns, folders of studies; see ``find_studies``.
    out : path
        The table, in the order of the studies. Earlier rows of other studies follow.
    method : str, default "auto"
        Estimator, one of ``jointid.estimation.identify_elasticity.METHODS``.
    workers : int, optional
        Processes on this computer; by default one per core.
    scheduler : str, optional
        Address of a Dask scheduler, such as "tcp://10.0.0.5:8786", to use its workers instead. Studies
        are sent as bytes; workers need no access to their paths.
    limits : Limits, optional
        Time and memory for one study.
    fresh : bool, default False
        Analyse everything again; drop the rows of ``out`` and its journal.
    progress : callable, optional
        Called with a ``Progress`` at the beginning and after every row.

    Raises JointIdError when there is no study, ``out`` is another kind of file or cannot be written,
    another batch writes it, or the cluster cannot be reached.
    """
    require_method(method)
    if workers is not None and scheduler is not None:
        raise JointIdError("workers applies to this computer, scheduler to a cluster: give one of them.")
    begin, target = time.perf_counter(), Path(os.path.abspath(out))
    found = find_studies(studies)
    require_folder(target)
    with closing(Journal(journal_path(target))) as journal:
        before = _rows_before(target, journal, fresh)
        same = {
            row.study: row.content
            for row in before.values()
            if row.is_final and (row.method, row.version) == (method, __version__)
        }
        jobs = [Job(key := path_text(path), path, method, same.get(key, "")) for path in found]
        rows: dict[str, Row] = {}
        skipped = failed = 0

        def report() -> None:
            if progress is not None:
                took = time.perf_counter() - begin
                progress(Progress(len(jobs), len(rows), skipped, failed, took))

        report()
        with closing(_executor(workers, scheduler, limits or Limits()).run(jobs)) as finished:
            for done in finished:
                if done.row is not None:
                    journal.add(done.row)
                row = rows[done.job.study] = done.row or before[done.job.study]
                skipped += done.row is None
                failed += not row.is_good
                report()
        here = [rows[job.study] for job in jobs]
        others = [row for study, row in before.items() if study not in rows]
        write_file(target, to_parquet([*here, *others]))
        journal.remove()
    return Summary(
        out=target,
        studies=len(here),
        skipped=skipped,
        failures=tuple(row for row in here if not row.is_good),
        verdicts={
            level: sum(row.verdict == level for row in here) for level in ("good", "warning", "problem")
        },
        kept=len(others),
        time_s=time.perf_counter() - begin,
    )


def _executor(workers: int | None, scheduler: str | None, limits: Limits) -> "Local | Cluster":
    if scheduler is not None:
        from jointid.fleet.cluster import Cluster

        return Cluster(scheduler, limits)
    if workers is None:  # one per core that this process may use
        here = hasattr(os, "sched_getaffinity")
        workers = len(os.sched_getaffinity(0)) if here else os.cpu_count() or 1
    return Local(workers, limits)


def _rows_before(target: Path, journal: Journal, fresh: bool) -> dict[str, Row]:
    """Rows by study, of the table and of the journal; the journal's take precedence."""
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
