"""The fleet that is open: tables of results, and studies analysed here; kept at the page's address."""

import os
from contextlib import closing
from dataclasses import dataclass, field

import streamlit as st

from jointid import JointIdError
from jointid.background.child_process import Limits
from jointid.files.store_files import checksum
from jointid.fleet.jobs import Job, Local
from jointid.fleet.row import Row
from jointid.fleet.studies import content_digest, packed
from jointid.fleet.table import read_untrusted, to_parquet
from jointid.ui.shared import workspace
from jointid.ui.shared.messages import show_error, show_warning
from jointid.ui.shared.results import steps_at
from jointid.wording import counted

_UPLOADER = "fleet_uploader"
_OPEN = "fleet_open"
_KEPT = "fleet_kept"
_PART = "fleet"
_LIMITS = Limits(time_s=120.0, memory_bytes=2 << 30)
_MOST_WORKERS = 2
"""Worker processes of one session."""


@dataclass
class OpenFleet:
    """The fleet of this session."""

    rows: dict[str, Row] = field(default_factory=dict)
    """By digest of the study's files, or by digest and path for rows of a table."""
    todo: dict[str, tuple[str, bytes]] = field(default_factory=dict)
    """Studies that have no row yet: name and zip, by digest."""
    tables: dict[str, bytes] = field(default_factory=dict)
    """Tables of results that are not read yet, by file name."""
    studies: dict[str, bytes] = field(default_factory=dict)
    """Zips of the studies that were dropped here, by digest."""
    problems: list[str] = field(default_factory=list)
    stopped: bool = False
    saved: str = ""
    """Digest of the table in the store; empty when it differs."""
    unkept: bool = False
    """Whether the store could not take the rows."""
    columns: dict[str, list[str]] = field(default_factory=dict)
    """The table of all studies as text, once it was made."""

    def add(self, key: str, row: Row) -> None:
        """Add a row, or put it in place of an earlier one."""
        self.rows[key] = row
        self.saved, self.unkept, self.columns = "", False, {}


def open_fleet() -> OpenFleet:
    """Ask for files, analyse the studies among them, and return the fleet."""
    fleet = _current()
    _restore(fleet)
    st.file_uploader(
        "results.parquet as jointid batch writes it, or studies, one .zip each",
        type=["parquet", "zip"],
        accept_multiple_files=True,
        help="Studies dropped here are analysed with the estimator auto.",
        key=_UPLOADER,
        on_change=_take,
    )
    _read_tables(fleet)
    for problem in fleet.problems:
        show_error(problem)
    _analyse(fleet)
    _keep(fleet)
    if fleet.rows or fleet.todo:
        left, right = st.columns([4, 1], vertical_alignment="center")
        kept = "The results are stored under this page's address until they are closed."
        unkept = "The results are open in this session only; save them below."
        left.caption(f"{counted(len(fleet.rows), 'study')} open. {kept if fleet.saved else unkept}")
        right.button("Close this fleet", on_click=_close, width="stretch")
    return fleet


def show_samples_button() -> None:
    """Offer a fleet of one kind of robot over five years, and the sample studies."""
    with st.container(horizontal=True):
        if (file := workspace.SAMPLES / "fleet.parquet").exists():
            show = "Show a sample fleet, 8 robots over 5 years"
            table = {file.name: file.read_bytes()}
            st.button(
                show,
                key="sample_fleet",
                type="primary",
                on_click=_current().tables.update,
                args=(table,),
            )
        if workspace.sample_paths():
            analyse = "Analyse the sample studies, of different robots"
            st.button(analyse, key="fleet_samples", on_click=_take_samples)


def _current() -> OpenFleet:
    fleet: OpenFleet = st.session_state.setdefault(_OPEN, OpenFleet())
    return fleet


def _take() -> None:
    """Take the dropped files; the uploader loses them when the page is left."""
    fleet = _current()
    fleet.problems, fleet.stopped = [], False
    for file in st.session_state.get(_UPLOADER) or []:
        data = file.getvalue()
        if file.name.lower().endswith(".zip"):
            _add(fleet, file.name, data)
        else:
            fleet.tables[file.name] = data


def _add_rows(fleet: OpenFleet, data: bytes) -> None:
    for row in _read(checksum(data), data):
        fleet.add(f"{row.content} {row.study}", row)


def _read_tables(fleet: OpenFleet) -> None:
    """Read the tables that were dropped: here, because a callback shows no progress."""
    for name, data in fleet.tables.items():
        try:
            _add_rows(fleet, data)
        except JointIdError as error:
            fleet.problems.append(f"{name}: {error}")
    fleet.tables = {}


def _take_samples() -> None:
    fleet = _current()
    fleet.stopped = False
    for name, path in workspace.sample_paths().items():
        _add(fleet, name, packed(path))


def _add(fleet: OpenFleet, name: str, data: bytes) -> None:
    digest = content_digest(data)
    fleet.studies[digest] = data
    if not any(row.content == digest for row in fleet.rows.values()):
        fleet.todo[digest] = (name, data)


@st.cache_resource(max_entries=8, show_spinner="Reading the results")
def _read(digest: str, _data: bytes) -> tuple[Row, ...]:
    return read_untrusted(_data)


def _analyse(fleet: OpenFleet) -> None:
    """Analyse the studies without a row; each row is kept at once, also after a stop."""
    if not fleet.todo:
        return
    if fleet.stopped:
        left, right = st.columns([4, 1], vertical_alignment="center")
        left.info(f"{counted(len(fleet.todo), 'study')} not analysed yet.")
        right.button("Resume", on_click=setattr, args=(fleet, "stopped", False), width="stretch")
        return
    jobs = [Job(name, data, content=digest) for digest, (name, data) in fleet.todo.items()]
    total, count, failed = len(jobs), 0, 0
    bar, stop = st.progress(0.0), st.empty()
    show = steps_at(bar)
    hint, stopping = "Finished rows are kept.", (fleet, "stopped", True)
    stop.button("Stop", key="fleet_stop", on_click=setattr, args=stopping, help=hint)
    workers = max(1, min(_MOST_WORKERS, os.cpu_count() or 1))

    def tell() -> None:
        """Show the progress; Streamlit raises here after a click on Stop or a change of page."""
        show(count / total, f"{count} of {total} analysed, {failed} failed")

    tell()
    try:
        with closing(Local(workers, _LIMITS, waiting=tell).run(jobs)) as finished:
            for done in finished:
                assert done.row is not None
                count += 1
                fleet.add(done.job.content, done.row)
                del fleet.todo[done.job.content]
                failed += not done.row.is_good
                tell()
    except JointIdError as error:
        fleet.stopped = True
        show_error(error)
    bar.empty()
    stop.empty()


def _close() -> None:
    st.session_state[_OPEN] = OpenFleet()
    st.session_state[_KEPT] = True
    with workspace.noting_problems():
        workspace.empty_part(_PART)


# --- kept at the address


def _keep(fleet: OpenFleet) -> None:
    """Write the rows to the store when they have changed; studies are kept when they are opened."""
    rows = list(fleet.rows.values())
    if not rows or fleet.todo or fleet.saved or fleet.unkept:
        return
    data = to_parquet(rows)
    digest = checksum(data)
    try:
        workspace.keep_part(_PART, "results.parquet", digest, data, beside=())
    except JointIdError as error:
        fleet.unkept = True
        show_warning(f"These results are open in this session only. {error}")
    else:
        fleet.saved = digest


def _restore(fleet: OpenFleet) -> None:
    """Restore the fleet of this address, once per session."""
    if st.session_state.get(_KEPT):
        return
    st.session_state[_KEPT] = True
    try:
        for digest in [] if fleet.rows else [*workspace.part_entries(_PART)][-1:]:
            _add_rows(fleet, workspace.read_part(_PART, digest) or b"")
            fleet.saved = digest
    except JointIdError as error:
        fleet.problems.append(f"The fleet that was open at this address cannot be shown. {error}")
