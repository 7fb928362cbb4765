"""jointid batch."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from jointid.analysis import answer_state
from jointid.cli.options import JSON, METHOD, named, require_ending
from jointid.cli.output import print_json, progress
from jointid.cli.program import INTERRUPTED, print_error
from jointid.errors import JointIdError
from jointid.wording import counted

if TYPE_CHECKING:
    from jointid.fleet import Progress, Summary

_MOST_FAILURES = 10  # failures printed; the table has them all
_REPORT_EVERY_S = 30.0  # interval of progress lines in a log file


def batch(
    studies: Annotated[
        list[str],
        typer.Argument(
            help="Studies: folders or .zip files, folders that contain studies at any depth, or quoted "
            "patterns such as 'cells/**/*.zip'.",
            show_default=False,
        ),
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Table of results, .parquet; required.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", hidden=True)] = None,  # its name before
    method: Annotated[str, METHOD] = "auto",
    workers: Annotated[
        int | None, typer.Option(min=1, help="Worker processes on this computer; default: one per core.")
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            help="Address of a Dask scheduler, such as tcp://10.0.0.5:8786, whose workers analyse the "
            "studies in place of this computer. They need the same version of jointid."
        ),
    ] = None,
    timeout: Annotated[float, typer.Option(help="Time limit per study, s.")] = 120.0,
    memory: Annotated[float, typer.Option(help="Memory limit per study, GiB.")] = 4.0,
    fresh: Annotated[bool, typer.Option("--fresh", help="Analyse all studies again.")] = False,
    as_json: Annotated[bool, JSON] = False,
) -> None:
    """Analyse many studies and write one table.

    Each study has a row, with its error if it cannot be read, or if its analysis exceeds a limit or
    crashes. The same command resumes an interrupted batch: finished rows are in OUTPUT.journal until
    the table is complete. Unchanged studies are not analysed again. Exit code 0: every study has a
    row, with or without an error; 1: nothing was done; 130: interrupted.
    """
    from jointid.fleet import Limits, analyse_fleet
    from jointid.fleet.run import journal_path

    for text in studies:
        named(text)
    if workers is not None and scheduler is not None:
        raise typer.BadParameter("Give --workers (this computer) or --scheduler (a cluster), not both.")
    if (out := output or out) is None:
        raise typer.BadParameter("--output is missing: the table of results, such as results.parquet.")
    require_ending("--output", out, ".parquet", ".pq")
    if not 0 < memory < 1e6:
        raise typer.BadParameter(f"--memory {memory:g}: expected a size in GiB, such as 4.")
    if not 0 < timeout < 1e7:
        raise typer.BadParameter(f"--timeout {timeout:g}: expected a time in seconds, such as 120.")
    limits = Limits(time_s=timeout, memory_bytes=int(memory * 2**30))
    count = [0, 0]
    try:
        if scheduler is not None:
            _quiet_dask()
        with _progress_display() as show:

            def tell(progress: Progress) -> None:
                count[:] = progress.done, progress.studies
                show(progress)

            summary = analyse_fleet(
                studies,
                out,
                method=method,
                workers=workers,
                scheduler=scheduler,
                limits=limits,
                fresh=fresh,
                progress=tell,
            )
    except KeyboardInterrupt:
        again = " without --fresh" if fresh else ""
        stopped = (
            f"Stopped after {count[0]} of {counted(count[1], 'study')}: finished rows are in "
            f"{journal_path(out)}. The same command{again} resumes the batch."
        )
        if as_json:
            print_error(stopped)
        typer.echo(stopped, err=True)
        raise typer.Exit(INTERRUPTED) from None
    except ModuleNotFoundError as error:
        if error.name not in ("distributed", "dask"):
            raise
        raise JointIdError(
            "--scheduler needs Dask, which is not installed: install jointid[cluster]."
        ) from error
    if as_json:
        print_json(_document(summary))
        return
    _print_summary(summary)


def _quiet_dask() -> None:
    """Silence Dask's log: this command reports the state of the cluster itself."""
    import_module("jointid.fleet.cluster")  # Dask sets its log levels on import
    for name in ("distributed", "distributed.client", "tornado.application", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)


def _document(summary: Summary) -> dict[str, Any]:
    names = ("studies", "good", "skipped", "kept", "verdicts", "time_s")
    failures = [
        {name: getattr(row, name) for name in ("study", "failure", "error")} for row in summary.failures
    ]
    return {
        "out": str(summary.out),
        **{name: getattr(summary, name) for name in names},
        "failed": len(failures),
        "studies_per_s": summary.rate,
        "failures": failures,
    }


def _print_summary(summary: Summary) -> None:
    new = summary.studies - summary.skipped
    print(f"{summary.out}: {counted(summary.studies, 'study')}, {summary.good} of them with an answer")
    print(", ".join(f"{n} {answer_state([level])}" for level, n in summary.verdicts.items()))
    print(f"Analysed now: {new} in {summary.time_s:.1f} s, {summary.rate:.3g} per second")
    if summary.skipped:
        print(f"Reused from an earlier batch: {summary.skipped}")
    if summary.kept:
        print(f"Rows of other studies, kept: {summary.kept}")
    if not summary.failures:
        return
    typer.echo(f"Failed: {len(summary.failures)}", err=True)
    for row in summary.failures[:_MOST_FAILURES]:
        typer.echo(f"{row.study}: {row.error}", err=True)
    if (more := len(summary.failures) - _MOST_FAILURES) > 0:
        typer.echo(f"… and {more} more: see the column error of {summary.out}", err=True)


@contextmanager
def _progress_display() -> Iterator[Callable[[Progress], None]]:
    """Show a progress bar on a terminal, else a line now and then for a log file."""
    if sys.stderr.isatty():
        with progress("Analysing") as bar:
            yield lambda p: bar(p.done / p.studies, p.text)
        return
    last = time.monotonic()

    def show(progress: Progress) -> None:
        nonlocal last
        if time.monotonic() - last >= _REPORT_EVERY_S and progress.done > progress.skipped:
            last = time.monotonic()
            typer.echo(progress.text, err=True)

    yield show
