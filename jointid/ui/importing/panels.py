"""The steps of the import page."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from jointid import JointIdError
from jointid.figures.log_spans import log_spans
from jointid.importing import (
    MappedLog,
    Mapping,
    Segment,
    apply_mapping,
    mapping_to_json,
    study_from_logs,
)
from jointid.importing.columns.units import QUANTITIES
from jointid.importing.map.reasons import assumptions
from jointid.importing.study import run_counts
from jointid.ui.importing.entries import Asked
from jointid.ui.importing.files import Log, choose_log, drop_logs, offer_new_import, once, show_raw
from jointid.ui.importing.inertia import offer_gears_of_model
from jointid.ui.importing.mapping import (
    entries_of,
    keep_mapping,
    mapping_files,
    mapping_of,
    offer_fresh_guess,
    problems_of,
    proposed_columns,
    remember,
    remember_problems,
    show_guesses,
)
from jointid.ui.importing.saved_import import (
    clear_entries,
    forget_import,
    is_finished,
    keep_import,
    show_storage_state,
)
from jointid.ui.importing.segments import chosen_segments, edit_segments, found_in, settle
from jointid.ui.importing.steps import COLUMNS, DRIVES, INERTIAS, LOGS, RUNS, STEPS, Steps, go_on
from jointid.ui.importing.study import ask_robot
from jointid.ui.importing.watched_work import StoppedError, Watch
from jointid.ui.shared.charts import is_dark, plot
from jointid.ui.shared.messages import show_error, show_note
from jointid.ui.shared.method_steps import OVERVIEW, REPORT, REPORT_AT_ONCE
from jointid.ui.shared.workspace import go_to, keep
from jointid.wording import counted, listed, minus, plain

_KINDS = {
    "gear ratio": "gear ratios",
    "scale": "rated torques or other factors",
    "torque hold": "torque held or not",
}
"""Description of a missing entry, by the beginning of its name."""


@dataclass(frozen=True, eq=False)
class Runs:
    """The mapped logs, and the sine runs to use of each."""

    logs: dict[str, MappedLog]
    used: dict[str, list[Segment]]
    problems: tuple[str, ...]
    """Rows of the table that cannot be used, and logs without a usable mapping."""


def import_steps(progress: DeltaGenerator) -> None:
    """Draw the steps, each as far as the earlier ones allow.

    ``progress`` is a place for that of long work, visible whichever step is open.
    """
    offer_new_import(clear_entries)
    steps = Steps()
    with steps.step(LOGS):
        logs = drop_logs(clear_entries, is_finished, progress)
        keep_import()
        show_storage_state()
        log = choose_log(logs) if logs else None
        names = ", ".join(each.table.name for each in logs[:3]) + ", …" * (len(logs) > 3)
        steps.tell(LOGS, log is not None, names)
    columns = drives = runs = None
    clicked = False
    wrong: list[str] = []
    with steps.step(COLUMNS):
        if log is not None:
            columns = _map_columns(steps, log, wrong)
    with steps.step(DRIVES):
        if log is not None and columns is not None:
            drives = _map_drives(steps, log, columns, wrong)
    if log is not None:
        remember_problems(log.table, wrong)
    with steps.step(RUNS):
        if log is not None and columns is not None and drives is not None:
            # Entries that are not confirmed start no new search.
            searched = columns if drives.to_confirm else drives.mapping
            runs = _choose_runs(logs, log, drives.mapping, searched, progress)
            used = [] if runs is None else [s for part in runs.used.values() for s in part]
            behind = runs is not None and any(each.arm_rad is not None for each in runs.logs.values())
            ready = bool(used) and runs is not None and not runs.problems
            steps.tell(RUNS, ready, _runs_in_words(used, behind))
            if ready:
                st.button("Continue", type="primary", key=f"go_on {RUNS}", on_click=go_on)
    with steps.step(INERTIAS):
        if log is not None and drives is not None and runs is not None:
            problems = [*problems_of((each.table for each in logs), log.table), *runs.problems]
            clicked = _open_as_study(steps, log, drives, runs, problems)
    steps.finish(clicked=clicked)


def _map_columns(steps: Steps, log: Log, wrong: list[str]) -> Mapping | None:
    """Show a log and its columns; return them once they are complete, and add what is wrong."""
    entries, _ = entries_of(log.key, log.table)
    try:
        asked = entries.ask_columns()
        steps.tell(COLUMNS, not (asked.missing or asked.to_confirm), _columns_in_words(asked))
    except JointIdError as error:
        show_error(error)
        wrong.append(_in_step(COLUMNS, error))
        steps.tell(COLUMNS, False, "to correct")
        asked = None
    with st.container(horizontal=True):
        show_guesses(log.key, log.table)
        mapping_files(log.key, log.table)
    show_raw(log.key, log.table, proposed_columns(log.key, log.table))
    return None if asked is None or asked.missing else asked.mapping


def _in_step(name: str, problem: object) -> str:
    """Say where a problem is that is shown in another step."""
    return f"Step {STEPS.index(name) + 1}, {problem}"


def _map_drives(steps: Steps, log: Log, columns: Mapping, wrong: list[str]) -> Asked | None:
    """Return the whole mapping with its missing entries, and add what is wrong."""
    entries, again = entries_of(log.key, log.table)
    if again:
        offer_fresh_guess(log.key, log.table)
    offer_gears_of_model(columns.n)
    try:
        asked = entries.ask_drives(columns)
    except JointIdError as error:
        show_error(error)
        wrong.append(_in_step(DRIVES, error))
        steps.tell(DRIVES, False, "to correct")
        return None
    wrong += [_in_step(DRIVES, problem) for problem in asked.problems]
    mapping = replace(asked.mapping, assumed=(*columns.assumed, *asked.mapping.assumed))
    remember(log.table, mapping)
    steps.tell(DRIVES, not asked.to_confirm, _drives_in_words(asked))
    return replace(asked, mapping=mapping)


def _choose_runs(
    logs: Sequence[Log], shown: Log, mapping: Mapping, searched: Mapping, progress: DeltaGenerator
) -> Runs | None:
    """Find the sine runs of all logs, let them be corrected, and draw those of one log."""
    ready: dict[str, MappedLog] = {}
    rules: dict[str, str] = {}
    searches: dict[str, tuple[str, MappedLog]] = {}
    unmapped: list[str] = []
    for log in logs:
        try:
            own = (
                mapping
                if log.table.signature == shown.table.signature
                else mapping_of(log.key, log.table)
            )
            by = searched if own is mapping else own
            rules[log.key], ready[log.key] = _mapped(log, own)
            searches[log.key] = _mapped(log, replace(by, torque_hold=False, torque_delay_s=0.0))
        except JointIdError as error:
            show_error(error)
            unmapped.append(str(error))
    if not ready:
        return None
    reading = {note for log in logs for note in log.table.notes}  # shown with the columns
    for note in [note for mapped_log in ready.values() for note in mapped_log.notes]:
        if note not in reading:
            show_note(note)
    picture = st.container()
    found = _found(searches, progress)
    rows = edit_segments(found, {key: mapped_log.name for key, mapped_log in ready.items()})
    kept, dropped, problems = chosen_segments(rows, ready, rules)
    for problem in problems:
        show_error(problem)
    if not problems and settle(rows, found, ready, rules):
        st.rerun()
    if shown.key in ready:
        with picture:
            spans = kept[shown.key], dropped[shown.key]
            figure = partial(log_spans, ready[shown.key], *spans, mapping=mapping, dark=is_dark())
            what = f"spans {shown.key} {mapping} {spans} {is_dark()}"
            plot(once(what, figure), "The log, motor side, with its sine runs as coloured spans")
    wrong = (_in_step(RUNS, f"Runs: {problem}") for problem in problems)
    return Runs(ready, kept, (*unmapped, *wrong))


def _mapped(log: Log, mapping: Mapping) -> tuple[str, MappedLog]:
    """A mapping as a key, without its assumptions, and the log in its terms."""
    text = mapping_to_json(replace(mapping, assumed=()))
    return text, once(f"mapped {log.key} {text}", partial(apply_mapping, log.table, mapping))


def _found(
    searches: dict[str, tuple[str, MappedLog]], progress: DeltaGenerator
) -> dict[str, tuple[Segment, ...]]:
    """Search all logs; after a stop, runs can still be marked by hand."""
    found: dict[str, tuple[Segment, ...]] = dict.fromkeys(searches, ())
    watch = Watch(len(searches), progress)
    for key, (rule, mapped_log) in searches.items():
        try:
            found[key] = found_in(watch, key, rule, mapped_log)
        except StoppedError:
            return found
        except JointIdError as error:
            show_error(error)
    if not any(found.values()):
        st.info(
            "No steady sine run and no coherent motion was found. Mark one in a new row of the table by "
            "its start and stop, or choose other columns: the method needs steady sines of a few "
            "periods, or several seconds of another motion."
        )
    return found


def _runs_in_words(used: Sequence[Segment], behind: bool) -> str:
    """``behind``: sensors are behind the gears; the analysis then chooses the motors' band itself."""
    if not used:
        return "mark a run, or choose other columns"
    if behind:
        return run_counts(used)
    hertz = [f for segment in used for f in segment.band_hz or (segment.frequency_hz,)]
    low, high = (plain(float(f"{f:.3g}")) for f in (min(hertz), max(hertz)))
    band = f"{low} Hz" if low == high else f"{low} to {high} Hz"
    return f"{run_counts(used)}, {band}"


def _open_as_study(steps: Steps, log: Log, drives: Asked, runs: Runs, problems: Sequence[str]) -> bool:
    """Ask for the robot; once it is complete, keep the study and switch to it. Return the click.

    ``problems`` are those of the other steps.
    """
    mapping = drives.mapping
    ratios = [joint.gear_ratio for joint in mapping.joints]
    assumed = assumptions(mapping)
    try:
        names = [each.name for each in runs.logs.values()]
        robot, state, clicked = ask_robot(ratios, names, assumed, problems)
        steps.tell(INERTIAS, state.startswith("M"), state)
        if robot is None:
            return bool(clicked)
        with st.spinner("Extracting the records"):
            study = study_from_logs(
                list(runs.logs.values()),
                [runs.used[key] for key in runs.logs],
                gear_ratio=drives.gear_ratio,
                assumed=assumed,
                **robot,
            )
            keep(study, study.name)
            keep_mapping(log.table, mapping)
            forget_import()
            if clicked == "report":
                st.session_state[REPORT_AT_ONCE] = st.session_state["chosen"]
        go_to(REPORT if clicked == "report" else OVERVIEW)
    except JointIdError as error:
        show_error(error)
    return True


def _columns_in_words(asked: Asked) -> str:
    """Content of the columns step, or its missing entries."""
    if asked.missing:
        return f"choose: {listed(asked.missing, at_most=3)}"
    time, n = asked.mapping.time, asked.mapping.n
    clock = f'time "{time.column}"' if time.column else "rows numbered"
    text = f"{clock}, {counted(n, 'joint')}"
    return f"{text}, to check" if asked.to_confirm else text


def _drives_in_words(asked: Asked) -> str:
    """Content of the drive step, or its missing entries."""
    m = asked.mapping
    if asked.problems:
        return "to correct"
    if asked.to_confirm and asked.missing:
        kinds = dict.fromkeys(_KINDS[what.partition(" of ")[0]] for what in asked.missing)
        return f"missing: {', '.join(kinds)}"
    if asked.missing:
        return f"assumed: {', '.join(assumptions(m))}"
    parts = []
    if asked.gear_ratio is not None:
        parts.append(f"gear ratios {', '.join(minus(plain(N)) for N in asked.gear_ratio)}")
    names = [f"scale of {role} of joint {j + 1}" for role in QUANTITIES for j in range(m.n)]
    parts += assumptions(replace(m, assumed=(*names, "torque hold")))
    return ", ".join(parts) + ", to confirm" * asked.to_confirm
