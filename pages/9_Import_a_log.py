"""Any controller's logs: columns mapped, sine runs found, opened as a study."""

import streamlit as st

from jointid import JointIdError
from jointid.figures.log_spans import log_spans
from jointid.importing import MappedLog, Segment, mapping_to_json, study_from_logs
from jointid.ui.importing.files import drop_logs
from jointid.ui.importing.mapping import (
    choose_mapping,
    keep_mapping,
    mapped,
    mapping_files,
    mapping_of,
    proposed_columns,
    remember,
)
from jointid.ui.importing.pictures import choose_log, show_raw
from jointid.ui.importing.saved_import import (
    clear_entries,
    forget_import,
    keep_import,
    kept_import,
    show_storage_state,
)
from jointid.ui.importing.segments import chosen_segments, edit_segments, found_in, settle
from jointid.ui.importing.study import ROBOT, ask_robot, show_next_step
from jointid.ui.importing.watched_work import StoppedError, Watch
from jointid.ui.shared.charts import is_dark, plot
from jointid.ui.shared.messages import show_error, show_note
from jointid.ui.shared.method_steps import OVERVIEW
from jointid.ui.shared.page import start
from jointid.ui.shared.workspace import keep

start("Import a log")
st.title("Import a log", anchor=False)
st.write(
    "Logs of any controller become a study: say what the columns are, check the sine runs that were "
    "found, and give the inertias. One long log with many runs is as good as one log per run."
)
with kept_import():
    logs = drop_logs(clear_entries)
    keep_import()
    show_storage_state()
    if not logs:
        st.caption(
            "For instance a CSV with `time; position; torque`, a header line and one row per sample."
        )
        st.stop()

    way = st.container()
    log = choose_log(logs)
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

    st.subheader("Sine runs", anchor=False)
    ready: dict[str, MappedLog] = {}
    rules: dict[str, str] = {}
    for each in logs:
        try:
            said = mapping if each is log else mapping_of(each.key, each.table)
            rules[each.key] = mapping_to_json(said)
            ready[each.key] = mapped(each.key, rules[each.key], each.table, said)
        except JointIdError as error:
            show_error(error)
    if not ready:
        st.stop()
    for note in [note for mapped_log in ready.values() for note in mapped_log.notes]:
        show_note(note)
    picture = st.container()
    found: dict[str, tuple[Segment, ...]] = dict.fromkeys(ready, ())
    watch, stopped = Watch("Search on", len(ready)), False
    for key, mapped_log in ready.items():
        try:
            found[key] = found_in(watch, key, rules[key], mapped_log)
        except StoppedError:
            stopped = True  # runs can still be marked by hand
            break
        except JointIdError as error:
            show_error(error)
    if not stopped and not any(found.values()):
        st.info(
            "No steady sine run was found. Mark one in a new row of the table by its start and stop, or "
            "choose other columns: the method needs steady sines of a few periods."
        )
    rows = edit_segments(found, {key: mapped_log.name for key, mapped_log in ready.items()})
    kept, dropped, problems = chosen_segments(rows, ready, rules)
    for problem in problems:
        show_error(problem)
    if not problems and settle(rows, found, ready, rules):
        st.rerun()
    if log.key in ready:
        with picture:
            figure = log_spans(ready[log.key], kept[log.key], dropped[log.key], dark=is_dark())
            plot(figure, "The log in SI units, motor side, with its sine runs as coloured spans")

    with way:
        show_next_step(kept, bool(not_confirmed))
    st.subheader("The robot", anchor=ROBOT)
    try:
        ratios = [joint.gear_ratio for joint in mapping.joints]
        names = [mapped_log.name for mapped_log in ready.values()]
        robot = ask_robot(ratios, names, not_confirmed)
        if robot is not None and not problems:
            with st.spinner("Cutting the records out"):
                study = study_from_logs(
                    list(ready.values()),
                    [kept[key] for key in ready],
                    robot.known.inertia,
                    nominal=robot.known.nominal,
                    poses=robot.known.poses,
                    pose_of=robot.pose_of,
                    name=robot.name,
                    robot=robot.robot,
                    date=robot.date,
                )
                keep(study, robot.name)
                keep_mapping(log.table, mapping)
                forget_import()
            st.switch_page(OVERVIEW.path)
    except JointIdError as error:
        show_error(error)
