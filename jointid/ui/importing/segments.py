"""The runs of the logs as a table; its corrections are kept beyond page and session."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from hashlib import blake2b
from typing import Any

import numpy as np
import streamlit as st

from jointid import JointIdError
from jointid.importing import MappedLog, Segment, find_runs, measure_motion, measure_run
from jointid.importing.columns.log_table import distinct_names
from jointid.ui.importing.watched_work import Watch
from jointid.ui.shared.messages import show_info
from jointid.ui.shared.results import result_cache
from jointid.wording import counted, significant

_USE, _LOG, _START, _STOP, _HERTZ = "Use", "Log", "Start (s)", "Stop (s)", "Frequency (Hz)"
_SETTLED = "import_segments_settled"
_LAST = "import_segments_last"
_SHOWN = "import_segments_shown"
"""Key of the rows that the table began with."""


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    log: str
    """Key of its log."""
    start_s: float | None = None
    stop_s: float | None = None
    frequency_hz: float | None = None
    """None: to be estimated."""
    use: bool = True
    found: Segment | None = None
    """The segment itself as long as nothing of it was changed."""
    motion: bool = False
    """Any motion, not a sine."""


def last_rows() -> dict[str, list[Row]]:
    """Return the rows by digest of the segments found in their log."""
    rows: dict[str, list[Row]] = st.session_state.setdefault(_LAST, {})
    return rows


def forget_rows() -> None:
    """Forget every correction."""
    for key in (_LAST, _SHOWN):
        st.session_state.pop(key, None)


def rows_to_json() -> dict[str, list[dict[str, Any]]]:
    """Return the session's rows as values that JSON can hold."""
    return {key: [asdict(row) for row in rows] for key, rows in last_rows().items()}


def rows_from_json(values: dict[str, list[dict[str, Any]]]) -> None:
    """Restore the result of ``rows_to_json``.

    Raises JointIdError, TypeError or AttributeError when it is something else.
    """
    st.session_state[_LAST] = {
        key: [Row(**row | {"found": row["found"] and Segment(**row["found"])}) for row in rows]
        for key, rows in values.items()
    }


def found_in(watch: Watch, key: str, mapping_json: str, log: MappedLog) -> tuple[Segment, ...]:
    """Find the segments of a log. Raises JointIdError when it holds too many, or after a stop."""
    label = f"Looking for steady sines in {log.name}"
    return watch.do(f"sines {key} {mapping_json}", label, lambda tell: find_runs(log, progress=tell))


def edit_segments(found: Mapping[str, Sequence[Segment]], names: Mapping[str, str]) -> list[Row]:
    """Show the segments of all logs in one table; corrections outlive the page.

    ``found`` and ``names`` are the segments and the name of each log by its key.
    """
    key = f"import segments {_digest(found)} {st.session_state.get(_SETTLED, 0)}"
    last = last_rows()
    if key not in st.session_state or st.session_state.get(_SHOWN, ("",))[0] != key:
        rows = [
            row
            for log, part in found.items()
            for row in last.get(_digest({log: part}), [_row(log, s) for s in part])
        ]
        st.session_state[_SHOWN] = (key, rows)
    rows = st.session_state[_SHOWN][1]
    labels = dict(zip(names, distinct_names(names.values()), strict=True))
    summary = st.empty()
    _table(rows, labels, key)
    st.caption(
        "Untick a run to leave it out, correct its times (s) or frequency f (Hz), or add one in the "
        "empty last row. Without a frequency, all lines of the span are estimated; a span without a "
        "steady line becomes a motion record."
    )
    for log, part in found.items():
        for note in getattr(part, "notes", ()):
            show_info(f"{names[log]}: {note}")
    edited = apply_edits(rows, st.session_state.get(key, {}), {v: k for k, v in labels.items()})
    for log, part in found.items():
        last[_digest({log: part})] = [row for row in edited if row.log == log]
    used = sum(row.use for row in edited)
    summary.markdown(f"{counted(len(edited), 'run')}, {used} used")
    return edited


def apply_edits(rows: Sequence[Row], edits: Mapping[str, Any], logs: Mapping[str, str]) -> list[Row]:
    """Return the rows as the user left them.

    ``edits`` is what ``st.data_editor`` keeps in the session: edited_rows, added_rows, deleted_rows.
    ``logs`` are keys of logs by their labels; a new row without one belongs to the first.
    """
    gone = set(edits.get("deleted_rows", ()))
    changed = {int(k): v for k, v in edits.get("edited_rows", {}).items()}
    left = [_changed(row, changed.get(k, {}), logs) for k, row in enumerate(rows) if k not in gone]
    first = next(iter(logs.values()))
    return left + [_changed(Row(first), cells, logs) for cells in edits.get("added_rows", ())]


def segment_of(row: Row, log: MappedLog, mapping_json: str) -> Segment | None:
    """Return the segment of a row, measured again after a correction; None while unfinished.

    Raises JointIdError when it is no segment of the log.
    """
    if row.found is not None:
        return row.found
    if row.start_s is None or row.stop_s is None:
        return None
    if row.frequency_hz is not None and row.frequency_hz <= 0:
        raise JointIdError(
            f"{significant(row.start_s)} to {significant(row.stop_s)} s: a frequency of "
            f"{row.frequency_hz:g} Hz. Enter a positive one, or leave it empty to estimate it."
        )
    measure = partial(measure_run, log, row.start_s, row.stop_s, row.frequency_hz)
    if row.motion and row.frequency_hz is None:
        measure = partial(measure_motion, log, row.start_s, row.stop_s)
    key = f"run {mapping_json} {row}"
    found: Segment = result_cache().get(key) or measure()
    result_cache().put(key, found)
    return found


def chosen_segments(
    rows: Sequence[Row], logs: Mapping[str, MappedLog], mapping_json: Mapping[str, str]
) -> tuple[dict[str, list[Segment]], dict[str, list[Segment]], list[str]]:
    """Return the segments to use, those left out, by log in order of time, and the problems."""
    kept: dict[str, list[Segment]] = {key: [] for key in logs}
    dropped: dict[str, list[Segment]] = {key: [] for key in logs}
    problems = []
    for row in rows:
        try:
            segment = segment_of(row, logs[row.log], mapping_json[row.log])
        except JointIdError as error:
            if row.use:
                problems.append(str(error))
            continue
        if segment is not None:
            (kept if row.use else dropped)[row.log].append(segment)
    for part in (*kept.values(), *dropped.values()):
        part.sort(key=lambda segment: segment.start_s)
    return kept, dropped, problems


def settle(
    rows: Sequence[Row],
    found: Mapping[str, Sequence[Segment]],
    logs: Mapping[str, MappedLog],
    mapping_json: Mapping[str, str],
) -> bool:
    """Replace corrected rows by their measured segments; return whether the table must be redrawn.

    Does nothing while a row is unfinished: redrawing takes the cursor away.
    """
    if all(row.found for row in rows) or any(None in (row.start_s, row.stop_s) for row in rows):
        return False
    last = last_rows()
    for key, part in found.items():
        settled = []
        for row in rows:
            if row.log == key and (s := segment_of(row, logs[key], mapping_json[key])) is not None:
                settled.append(replace(_row(key, s), use=row.use))
        last[_digest({key: part})] = sorted(settled, key=lambda row: row.start_s or 0.0)
    st.session_state[_SETTLED] = st.session_state.get(_SETTLED, 0) + 1
    return True


def _changed(row: Row, cells: Mapping[str, Any], logs: Mapping[str, str]) -> Row:
    if not cells:
        return row
    use = cells.get(_USE, row.use)
    values = {
        "start_s": cells.get(_START, row.start_s),
        "stop_s": cells.get(_STOP, row.stop_s),
        "frequency_hz": cells.get(_HERTZ, row.frequency_hz),
    }
    if row.found is not None and row.found.is_multisine and {_START, _STOP} & set(cells):
        # One number cannot state several lines: they are looked for again in the new times.
        values["frequency_hz"] = cells.get(_HERTZ)
    log = logs.get(cells.get(_LOG, ""), row.log)
    same = not {_START, _STOP, _HERTZ, _LOG} & set(cells)
    return replace(row, log=log, use=bool(use), found=row.found if same else None, **values)


def _row(log: str, s: Segment) -> Row:
    hertz = None if s.is_motion else s.frequency_hz
    return Row(log, s.start_s, s.stop_s, hertz, found=s, motion=s.is_motion)


def _table(rows: Sequence[Row], labels: Mapping[str, str], key: str) -> None:
    column = st.column_config
    number = column.NumberColumn
    columns: dict[str, Any] = {_USE: np.array([row.use for row in rows], bool)}
    settings: dict[str, Any] = {
        # Narrow: a phone shows these four.
        _USE: column.CheckboxColumn(default=True, width=58),
        _START: number("Start", width=80, help=_START, format="%.3f", required=True),
        _STOP: number("Stop", width=80, help=_STOP, format="%.3f", required=True),
        _HERTZ: number("f", width=66, help=f"{_HERTZ}. Leave it empty to estimate it.", format="%.5g"),
    }
    if len(labels) > 1:
        columns[_LOG] = [labels[row.log] for row in rows]
        options = list(labels.values())
        settings[_LOG] = column.SelectboxColumn(options=options, default=options[0], required=True)
    for name, attribute in ((_START, "start_s"), (_STOP, "stop_s"), (_HERTZ, "frequency_hz")):
        digits = ".7g" if name == _HERTZ else ".6f"  # as typed: times to the microsecond
        values = [getattr(row, attribute) for row in rows]
        columns[name] = np.array([math.nan if v is None else float(f"{v:{digits}}") for v in values])
    if any(row.found is not None and row.found.is_motion for row in rows):
        columns["Coherent band (Hz)"] = [_band(row.found) for row in rows]
    columns["Periods"] = [_periods(row) for row in rows]
    hint = "Share of the signal's variance that the sine explains; largest of all joints."
    for name, share in (("Motion explained", "share"), ("Torque explained", "torque_share")):
        shares = [getattr(row.found, share, math.nan) for row in rows]
        columns[name] = ["" if math.isnan(x) else f"{100 * x:.2f} %" for x in shares]
        settings[name] = column.TextColumn(help=hint)
    if any(row.found is not None and row.found.is_multisine for row in rows):
        columns["Lines (Hz)"] = [
            ", ".join(significant(f) for f in row.found.lines_hz) if row.found else "" for row in rows
        ]
    st.data_editor(
        columns,
        column_config=settings,
        disabled=["Coherent band (Hz)", "Periods", "Motion explained", "Torque explained", "Lines (Hz)"],
        num_rows="dynamic",
        hide_index=True,
        height=min(36 + 35 * (len(rows) + 1), 430),
        placeholder="",
        key=key,
    )


def _periods(row: Row) -> str:
    if row.start_s is None or row.stop_s is None or row.frequency_hz is None:
        return ""
    return f"{(row.stop_s - row.start_s) * row.frequency_hz:.1f}"


def _band(segment: Segment | None) -> str:
    if segment is None or segment.band_hz is None:
        return ""
    return "–".join(significant(f, 3) for f in segment.band_hz)


def _digest(found: Mapping[str, Sequence[Segment]]) -> str:
    """Identify a table; rounded, because another gear ratio changes the last bits only."""
    rows = [
        (log, [f"{s.start_s:.6g} {s.stop_s:.6g} {s.frequency_hz:.4g}" for s in part])
        for log, part in found.items()
    ]
    return blake2b(repr(rows).encode(), digest_size=12).hexdigest()
