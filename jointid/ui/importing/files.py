"""Dropped logs, read once and kept in the session, and their first picture."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from hashlib import blake2b
from typing import TypeVar

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from jointid import JointIdError
from jointid.figures import raw_columns
from jointid.importing import LogTable, read_log
from jointid.importing.columns.log_table import MAX_LOG_BYTES
from jointid.importing.map.simultaneous_logs import joined_table, proposed_tables, simultaneous_groups
from jointid.ui.importing.steps import go_on
from jointid.ui.importing.watched_work import Progress, StoppedError, Watch
from jointid.ui.shared.charts import is_dark, plot, table
from jointid.ui.shared.messages import markdown_escape, show_error, show_info, show_note, show_warning
from jointid.ui.shared.method_steps import OPEN_LOGS
from jointid.wording import listed

T = TypeVar("T")
_UPLOADER = "log_file"
_HELD = "held_logs"
_CLOSED = "closed_imports"
_ADDED = "logs_added_to_a_finished_import"
_NEW_IMPORT = "Start a new import"


@dataclass(frozen=True, eq=False)
class Dropped:
    """A file as it was dropped."""

    name: str
    data: bytes
    digest: str


@dataclass(frozen=True, eq=False)
class Log:
    """One table of a file."""

    key: str
    """For caches: digest of the file's bytes, and which table of it."""
    table: LogTable


def drop_logs(
    forget: Callable[[], None], finished: Callable[[], bool], progress: DeltaGenerator
) -> list[Log]:
    """Ask for files, read them with their errors shown, and ask which tables to use.

    ``forget`` clears the entries of logs that are closed; ``finished`` tells whether a study was made of
    the open ones; ``progress`` is a place for that of reading.
    """
    uploader = _uploader()
    st.file_uploader(
        "Logs: CSV or any text table, TwinCAT, CODESYS, LabVIEW, MDF, MATLAB, HDF5, Parquet, Excel, ROS "
        "bags and more, or a .zip of them",
        accept_multiple_files=True,
        max_upload_size=MAX_LOG_BYTES >> 20,
        key=uploader,
        on_change=_take,
        args=(forget, finished),
    )
    files = dropped()
    if not st.session_state.get(uploader):
        hold(files)
    if held := st.session_state.get(_HELD):
        size = sum(len(file.data) for file in files) / 2**20
        show_note(f"Still open: {', '.join(file.name for file in held)}. {size:.1f} MiB in all.")
    first, all_logs = [], {}
    watch = Watch(len(files), progress)
    for file in files:
        try:
            read = partial(_read, file)
            tables = watch.do(f"log {file.digest} {file.name}", f"Reading {file.name}", read)
        except StoppedError:
            break
        except JointIdError as error:
            show_error(error)
            continue
        logs = [Log(f"{file.digest} {k}", table) for k, table in enumerate(tables)]
        main = once(f"main {file.digest}", partial(proposed_tables, tables))
        first += [log.key for log in logs if log.table in main]
        all_logs.update({log.key: log for log in logs})
    if len(all_logs) < 2:
        return list(all_logs.values())
    chosen = st.multiselect(
        "Tables to use",
        list(all_logs),
        default=list(dict.fromkeys(first)),
        format_func=lambda key: all_logs[key].table.name,
        key="import tables " + _short(all_logs),
        persist_state="session",
        help="A file may hold several tables; the one with the most numbers is proposed.",
    )
    return _joined([all_logs[key] for key in chosen])


def offer_new_import(forget: Callable[[], None]) -> None:
    """Offer to close all logs, whichever step is open; ``forget`` clears their entries."""
    if not dropped():
        return
    hint = "Closes all logs and clears inertias, runs and confirmations."
    st.button(_NEW_IMPORT, on_click=_close, args=(forget,), help=hint)
    if added := st.session_state.get(_ADDED):
        show_warning(
            f"Added to the logs of the finished import, with its drive data and inertias: {added}. "
            f'For another robot or measurement, click "{_NEW_IMPORT}" and drop the new log again.'
        )


def dropped() -> list[Dropped]:
    """Return the files that are open in this session."""
    files: list[Dropped] = st.session_state.get(OPEN_LOGS, [])
    return files


def hold(files: list[Dropped]) -> None:
    """Hold these files open: the uploader loses them when the page is left."""
    st.session_state[_HELD] = st.session_state[OPEN_LOGS] = files


def _joined(logs: list[Log]) -> list[Log]:
    """Join logs that look like simultaneously recorded joints, if confirmed."""
    result = {log.key: log for log in logs}
    groups = partial(simultaneous_groups, [log.table for log in logs])
    for group in once(f"groups {' '.join(result)}", groups):
        parts = [logs[index] for index in group]
        names = listed(log.table.name for log in parts)
        show_info(
            f"{names} have the same times and columns: they look like joints logged simultaneously."
        )
        together = st.checkbox(
            markdown_escape(f"Join {names} as one joint each"),
            value=True,
            key="import join " + _short(log.key for log in parts),
            persist_state="session",
            help="Otherwise they are runs of one joint.",
        )
        if together:
            key = "joined " + " ".join(log.key for log in parts)
            table = once(key, partial(joined_table, [log.table for log in parts]))
            result[parts[0].key] = Log(key, table)
            for log in parts[1:]:
                del result[log.key]
    return list(result.values())


@st.cache_resource(scope="session", max_entries=64, show_spinner=False)
def once(key: str, _compute: Callable[[], T]) -> T:
    """Return what a function computes, once per key in this session."""
    return _compute()


def _uploader() -> str:
    """Key of the uploader; another one holds no files."""
    number = st.session_state.get(_CLOSED, 0)
    return f"{_UPLOADER} {number}" if number else _UPLOADER


def _take(forget: Callable[[], None], finished: Callable[[], bool]) -> None:
    """Open the uploaded files beside the held ones, and close those removed from the uploader."""
    files: dict[str, Dropped] = {file.digest: file for file in st.session_state.get(_HELD, [])}
    held, was_finished = [*files], finished()
    for file in st.session_state.get(_uploader()) or []:
        data = file.getvalue()
        digest = blake2b(data, digest_size=16).hexdigest()
        files[digest] = Dropped(file.name, data, digest)
    if not files and dropped():
        forget()
    new = [file.name for digest, file in files.items() if digest not in held]
    if held and new and was_finished:
        st.session_state[_ADDED] = listed(new)
        unconfirm()
    st.session_state[OPEN_LOGS] = list(files.values())
    go_on()


def unconfirm() -> None:
    """Withdraw all confirmations: the entries of other logs are to be checked again."""
    for key in [key for key in st.session_state if str(key).startswith("import confirmed ")]:
        del st.session_state[key]


def _close(forget: Callable[[], None]) -> None:
    """Close all logs, those in the uploader too: no field stays on the page with its old value."""
    forget()
    unconfirm()
    for key in (_HELD, OPEN_LOGS, _ADDED):
        st.session_state.pop(key, None)
    st.session_state[_CLOSED] = st.session_state.get(_CLOSED, 0) + 1
    go_on()


def _short(keys: Iterable[str]) -> str:
    return blake2b("".join(keys).encode(), digest_size=8).hexdigest()


def _read(file: Dropped, _: Progress) -> tuple[LogTable, ...]:
    return read_log(file.data, file.name)


_FIRST_ROWS = 50
_FEW_CURVES = 4


def choose_log(logs: Sequence[Log]) -> Log:
    """Ask which log to look at when there are several."""
    if len(logs) == 1:
        return logs[0]
    by_key = {log.key: log for log in logs}
    if st.session_state.get("import look", logs[0].key) not in by_key:
        del st.session_state["import look"]
    key = st.selectbox(
        "Log to show",
        list(by_key),
        format_func=lambda key: by_key[key].table.name,
        key="import look",
        persist_state="session",
        help="Logs with the same columns share the entries of steps 2 and 3. All of them go into the "
        "study.",
    )
    return by_key[key]


def show_raw(key: str, log: LogTable, proposed: Sequence[str]) -> None:
    """First rows, and curves of some columns over the time column or the row."""
    for note in log.notes:
        show_note(note)
    left, right = st.columns([2, 3])
    with left:
        size = f"{log.rows} rows, {len(log.columns)} columns"
        show_note(f"{log.name}, read as {log.read_as}: {size}. The first rows:")
        headings = {c.name: f"{c.name} ({c.unit})" if c.unit else c.name for c in log.columns}
        names = list(log.names)
        time = proposed[0] if proposed else names[0]
        rows = {headings[c.name]: c.values[:_FIRST_ROWS].tolist() for c in log.columns}
        table(rows, height=400, exact=headings[time])
    with right:
        others = [name for name in names if name != time]
        curves = others if len(others) <= _FEW_CURVES else list(proposed[1:]) or others
        widget = f"import curves {log.signature}"
        begun = curves[:_FEW_CURVES]
        chosen = st.multiselect(
            "Columns in the figure", others, begun, key=widget, persist_state="session"
        )
        if chosen:
            shown = {headings[name]: log.column(name).values for name in (time, *chosen)}
            figure = partial(raw_columns, shown, dark=is_dark())
            what = f"columns {key} {[*shown]} {is_dark()}"
            plot(once(what, figure), "Columns as they are in the file")
