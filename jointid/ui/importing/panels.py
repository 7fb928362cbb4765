"""The steps of the import page: columns, sine runs, and the study."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import streamlit as st

from jointid import JointIdError
from jointid.figures.log_spans import log_spans
from jointid.importing import MappedLog, Mapping, Segment, mapping_to_json, study_from_logs
from jointid.ui.importing.files import Log
from jointid.ui.importing.mapping import (
    choose_mapping,
    keep_mapping,
    mapped,
    mapping_files,
    mapping_of,
    proposed_columns,
    remember,
)
from jointid.ui.importing.pictures import show_raw
from jointid.ui.importing.saved_import import forget_import
from jointid.ui.importing.segments import chosen_segments, edit_segments, found_in, settle
from jointid.ui.importing.study import ROBOT, ask_robot
from jointid.ui.importing.watched_work import StoppedError, Watch
from jointid.ui.shared.charts import is_dark, plot
from jointid.ui.shared.messages import show_error, show_note
from jointid.ui.shared.method_steps import OVERVIEW
from jointid.ui.shared.workspace import keep


@dataclass(frozen=True, eq=False)
class Runs:
    """The mapped logs, and the sine runs to use of each."""

    logs: dict[str, MappedLog]
    used: dict[str, list[Segment]]
    has_problems: bool
    """Whether a row of the table is unusable."""


def map_columns(log: Log) -> tuple[Mapping, str]:
    """Show a log and the entries of its mapping; return it, and its unconfirmed part in words.

    Without a mapping the page ends here.
    """
    raw = st.container()
    st.subheader("What the columns are", anchor=False)
    mapping, not_confirmed, clear = None, "", False
    try:
        mapping, not_confirmed, clear = choose_mapping(log.key, log.table)
        remember(log.table, mapping)
    except JointIdError as error:
        show_error(error)
    with raw:
        show_raw(log.table, proposed_columns(log.key, log.table), folded=clear)
    mapping_files(log.table, mapping)
    if mapping is None:
        st.stop()
    return mapping, not_confirmed


def choose_runs(logs: Sequence[Log], shown: Log, mapping: Mapping) -> Runs:
    """Find the sine runs of all logs, let them be corrected, and draw those of one log.

    Without a log that can be mapped the page ends here.
    """
    st.subheader("Runs", anchor=False)
    ready: dict[str, MappedLog] = {}
    rules: dict[str, str] = {}
    for log in logs:
        try:
            own = mapping if log is shown else mapping_of(log.key, log.table)
            rules[log.key] = mapping_to_json(own)
            ready[log.key] = mapped(log.key, rules[log.key], log.table, own)
        except JointIdError as error:
            show_error(error)
    if not ready:
        st.stop()
    for note in [note for mapped_log in ready.values() for note in mapped_log.notes]:
        show_note(note)
    picture = st.container()
    found = _found(ready, rules)
    rows = edit_segments(found, {key: mapped_log.name for key, mapped_log in ready.items()})
    kept, dropped, problems = chosen_segments(rows, ready, rules)
    for problem in problems:
        show_error(problem)
    if not problems and settle(rows, found, ready, rules):
        st.rerun()
    if shown.key in ready:
        with picture:
            spans = kept[shown.key], dropped[shown.key]
            figure = log_spans(ready[shown.key], *spans, dark=is_dark())
            plot(figure, "The log in SI units, motor side, with its sine runs as coloured spans")
    return Runs(ready, kept, bool(problems))


def _found(ready: dict[str, MappedLog], rules: dict[str, str]) -> dict[str, tuple[Segment, ...]]:
    """Search all logs; after a stop, runs can still be marked by hand."""
    found: dict[str, tuple[Segment, ...]] = dict.fromkeys(ready, ())
    watch = Watch(len(ready))
    for key, mapped_log in ready.items():
        try:
            found[key] = found_in(watch, key, rules[key], mapped_log)
        except StoppedError:
            return found
        except JointIdError as error:
            show_error(error)
    if not any(found.values()):
        st.info(
            "No steady sine run and no coherent motion was found. Mark one in a new row of the table by "
            "its start and stop, or choose other columns: the method needs steady sines of a few "
            "periods, or seconds of another motion."
        )
    return found


def open_as_study(log: Log, mapping: Mapping, runs: Runs, not_confirmed: str) -> None:
    """Ask for the robot; once it is complete, keep the study and switch to it."""
    st.subheader("The robot", anchor=ROBOT)
    try:
        ratios = [joint.gear_ratio for joint in mapping.joints]
        robot = ask_robot(ratios, [mapped_log.name for mapped_log in runs.logs.values()], not_confirmed)
        if robot is None or runs.has_problems:
            return
        with st.spinner("Cutting the records out"):
            study = study_from_logs(
                list(runs.logs.values()),
                [runs.used[key] for key in runs.logs],
                robot.known.inertia,
                nominal=robot.known.nominal,
                poses=robot.known.poses,
                pose_of=robot.pose_of,
                name=robot.name,
                robot=robot.robot,
                date=robot.date,
                inertia_std=robot.known.inertia_std,
                torque_std=robot.known.torque_std,
            )
            keep(study, robot.name)
            keep_mapping(log.table, mapping)
            forget_import()
        st.switch_page(OVERVIEW.path)
    except JointIdError as error:
        show_error(error)
