"""Output: tables for people, JSON for machines, progress on standard error."""

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from jointid.analysis import NOT_USABLE, Answer
from jointid.study import Study
from jointid.wording import counted


def print_json(document: dict[str, Any]) -> None:
    """Print a document as JSON on standard output; numbers that JSON cannot hold become null."""
    from jointid.exporting.identification import with_infinite_as

    finite = with_infinite_as(None, document)
    print(json.dumps(finite, indent=2, ensure_ascii=False, allow_nan=False))


def print_table(header: list[str], rows: list[list[str]], *, right: tuple[int, ...] = ()) -> None:
    """Print rows under a header; the columns ``right`` hold numbers."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for k, title in enumerate(header):
        table.add_column(Text(title), justify="right" if k in right else "left")
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    Console(width=None if sys.stdout.isatty() else 200).print(table)


def print_columns(columns: Mapping[str, Sequence[str]], *, right: tuple[int, ...] = ()) -> None:
    """Print columns by their heading, see ``print_table``."""
    rows = [list(row) for row in zip(*columns.values(), strict=True)]
    print_table(list(columns), rows, right=right)


def warn_if_unusable(analysis: Answer) -> None:
    """State on standard error that an answer is not usable, and where the reason is."""
    if analysis.state == NOT_USABLE:
        print(f"{analysis.headline} See jointid identify.", file=sys.stderr)


@contextmanager
def progress(what: str) -> Iterator[Callable[..., None]]:
    """Show a progress bar on a terminal: the present step until its share done, or a text, is known."""
    if not sys.stderr.isatty():
        yield lambda fraction, text="": None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=None)
        yield lambda fraction, text=what: bar.update(
            task, total=1.0, completed=fraction, description=text
        )


def print_new_study(study: Study, path: Path, as_json: bool, **more: Any) -> None:
    """Print the contents of a new study."""
    from jointid.files.digest import study_digest

    digest, n = study_digest(study), study.inertia.n
    if not as_json:
        print(
            f"{path}: {counted(len(study.records), 'record')} of {counted(n, 'joint')}, digest {digest}"
        )
        return
    keys = ("frequency_hz", "periods", "band_hz")
    records = [
        {"label": r.label, "samples": int(r.time_s.size)}
        | {key: getattr(r, key) for key in keys if hasattr(r, key)}
        for r in study.records
    ]
    print_json({"study": str(path), "digest": digest, "joints": n, "records": records} | more)


def print_written(files: list[Path], as_json: bool) -> None:
    """Print the names of the written files."""
    if as_json:
        print_json({"written": [str(file) for file in files]})
        return
    for file in files:
        print(f"{file}: {file.stat().st_size} bytes")
