"""The first screen, and changes that may remedy a finding: offered, previewed, made, undone."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import streamlit as st

from jointid import Analysis, Finding, JointIdError, Study
from jointid.analysis import NOT_USABLE, USABLE, WITH_CARE, Answer
from jointid.answer import ERROR_BARS, UNSTATED_TORQUE_SCALE, change_from
from jointid.corrections.changes import corrected, label
from jointid.estimation.quantities import Quantity
from jointid.figures.response_curves import in_legend, removed_effects
from jointid.files.digest import study_digest
from jointid.ui.shared import workspace
from jointid.ui.shared.messages import (
    markdown_escape,
    show_error,
    show_note,
    show_text_table,
    show_warning,
)
from jointid.ui.shared.method_steps import ACTIONS, METHOD, OPEN_LOGS, OVERVIEW
from jointid.ui.shared.page import Page
from jointid.uncertainty.comparison import values_shown
from jointid.verdict.evidence import Change
from jointid.wording import UNDETERMINED, capitalised, counted, plain, significant, unbroken

_PREVIEWED, _BEFORE = "previewed_change", "study_before_change"
_APPLIED = "change_applied"
_SUFFIX = ", corrected"
_PART = "corrections"


def show_changes(page: Page) -> None:
    """List the changes to the data as logged, with a way back."""
    if not page.study.changes:
        return
    if st.session_state.pop(_APPLIED, False):  # the box below may be out of sight
        st.toast("The study has been changed. The changes, and Undo, are at the top of the page.")
    with st.container(border=True):
        show_note(f"Changed from the data as logged: {' '.join(page.study.changes)}")
        before = _before(page.digest)
        if before in workspace.names_by_address():
            st.button("Undo the last change", key="undo_change", on_click=_undo, args=(before,))


def offer_changes(page: Page, analysis: Answer, finding: Finding) -> None:
    """Offer the changes that may remedy a finding, and the answer with the one being looked at."""
    fault = _is_fault(finding)
    if not isinstance(analysis, Analysis) or not finding.changes:
        return
    if analysis.state == NOT_USABLE and not fault:
        return
    texts = [label(page.study, change) for change in finding.changes]
    kind = "Fix it" if fault else "Optional"
    with st.container(horizontal=True):
        for text in texts:
            chosen = (page.digest, text)
            st.button(f"{kind}: {text}", key=f"fix {text}", on_click=_look_at, args=(chosen,))
    for text, change in zip(texts, finding.changes, strict=True):
        if st.session_state.get(_PREVIEWED) == (page.digest, text):
            _preview(page, analysis, change)


def _preview(page: Page, analysis: Analysis, change: Change) -> None:
    with st.container(border=True):
        try:
            study = corrected(page.study, change)
            changed = replace(page, study=study, digest=study_digest(study))
            after = replace(changed.analysed(), unit=analysis.unit)
        except JointIdError as error:
            show_error(error)
            st.button("Close", key="cancel_change", on_click=_look_at, args=(None,))
            return
        st.markdown("**Before and after**")
        show_note(study.changes[-1])
        show_text_table(_compared(analysis, after))
        if change.kind in ("order", "scale"):
            st.caption("The residuals in the finding come from a quick check without friction.")
        show_note(after.headline)
        helps = after.state != NOT_USABLE
        if not helps:
            show_warning("With this change alone, the answer remains not usable.")
        with st.container(horizontal=True):
            st.button(
                "Apply",
                key="apply_change",
                type="primary" if helps else "secondary",
                on_click=_apply,
                args=(page, study),
                help="Makes a new study with this change. The current one stays in the list.",
            )
            st.button("Cancel", key="cancel_change", on_click=_look_at, args=(None,))


def _compared(before: Analysis, after: Analysis) -> dict[str, list[str]]:
    names = [found.heading for found in before.quantities]
    columns = {"": ["State", *names, "Residual of the whole model / noise"]}
    for heading, each in (("Now", before), ("With the change", after)):
        misfit = float(np.sqrt(each.fit.misfit))
        columns[heading] = [
            each.state,
            *values_shown(each.quantities, usable=each.state != NOT_USABLE),
            significant(misfit, 2) if np.isfinite(misfit) else UNDETERMINED,
        ]
    return columns


def _look_at(chosen: tuple[str, str] | None) -> None:
    st.session_state[_PREVIEWED] = chosen


def _apply(page: Page, study: Study) -> None:
    """Keep the corrected study and show it; the workspace remembers its origin."""
    digest, before = study_digest(study), str(st.session_state["chosen"])
    workspace.keep(study, page.key.removesuffix(_SUFFIX) + _SUFFIX)
    with workspace.noting_problems("The change can be undone in this session only. "):
        workspace.keep_part(_PART, "Study before a change", digest, before.encode())
    st.session_state.setdefault(_BEFORE, {})[digest] = before
    st.session_state[_APPLIED] = True
    _look_at(None)


def _before(digest: str) -> str | None:
    """Key of the study that a changed one was made from, read once per session."""
    known: dict[str, str | None] = st.session_state.setdefault(_BEFORE, {})
    if digest not in known:
        known[digest] = None
        with workspace.noting_problems():
            kept = workspace.read_part(_PART, digest)
            known[digest] = None if kept is None else kept.decode()
    return known[digest]


def _undo(before: str) -> None:
    """Show the study before the change, and remove the changed one."""
    for entry in workspace.recent().values():
        if entry.digest == st.session_state["chosen"]:
            workspace.change_store("delete", entry.id)
    st.session_state["chosen"] = before


_BOXES = {"problem": st.error, "warning": st.warning, "note": st.info, "good": st.success}
_STATE_COLOURS = {USABLE: "green", WITH_CARE: "orange"}
_MOST_FINDINGS = 3
_NOMINAL = "Nominal: in the controller at present."
_MOST_TILES = 4
"""Joints; more are shown in a table."""
_TILE_GAP = 16  # px, streamlit's
_TILE_WIDTH = 214  # px: room for "0.015006 ± 0.000007", and four in a row at 1366 px


def show_heading(page: Page) -> None:
    """Name, origin and contents; the name in the list where it is another."""
    study = page.study
    st.title(markdown_escape(study.name) or "Study without a name", anchor=False)
    badge = f":gray-badge[{study.origin or 'origin not stated'}]"
    listed = [] if page.label == study.name else [f"listed as {markdown_escape(page.label)}"]
    st.markdown(" &nbsp;·&nbsp; ".join([badge, *listed, *map(unbroken, study.facts)]))
    for text in (study.description, *study.remarks):
        if text:
            st.caption(markdown_escape(text))


def show_headline(analysis: Answer, page: Page | None = None) -> None:
    """The answer as a sentence, or why it is not usable; what limits it.

    With a page, the reason comes with its finding and the changes that may remedy it, else with a link.
    """
    _show_state(analysis, page)
    if analysis.sensors and page is not None:  # else the page shows them itself
        show_note(f"Sensors behind the gears, {analysis.sensors.state}: {analysis.sensors.headline}")


def _show_state(analysis: Answer, page: Page | None) -> None:
    if analysis.state == NOT_USABLE:
        lead = f"## {markdown_escape(analysis.headline)}"
        if page is None:
            st.error(lead)
            workspace.link_to(OVERVIEW, f"{OVERVIEW.name}: findings and remedies")
        else:
            _finding(page, analysis, analysis.findings[0], lead)
        return
    st.markdown(f":{_STATE_COLOURS[analysis.state]}-badge[{analysis.state.capitalize()}]")
    hint = None if analysis.torque_stated else UNSTATED_TORQUE_SCALE
    st.header(unbroken(analysis.headline), anchor=False, help=hint)
    if analysis.state == WITH_CARE:
        show_note(f"{analysis.state_reason}.")
    if analysis.unit.is_default and str(st.session_state.get("unit")).endswith("joint"):
        st.caption("The study has no gear ratios: K and D are shown at the motor.")


def warn_if_unusable(analysis: Answer) -> None:
    """Say on another page that the answer is not usable, with the way to its reason."""
    if analysis.state == NOT_USABLE:
        show_error(analysis.headline)
        workspace.link_to(OVERVIEW, f"{OVERVIEW.name}: findings and remedies")


def show_tiles(analysis: Analysis) -> None:
    """K and D of every joint with ± one standard error, against the nominal values, if usable."""
    if analysis.state == NOT_USABLE:
        return
    n = analysis.fit.n
    found = analysis.quantities
    if n > _MOST_TILES:
        for place, own in zip(st.columns(2), (found[:n], found[n:]), strict=True):
            with place:
                show_text_table(_values_table(analysis, own))
        st.caption(f"K and D {analysis.unit.side}. {ERROR_BARS} {_NOMINAL}")
        return
    with st.container(horizontal=True):  # K1, K2, D1, D2, as in sentences, tables and files
        for row in (found[:n], found[n:]) if n > 1 else (found,):
            width = len(row) * (_TILE_WIDTH + _TILE_GAP) - _TILE_GAP
            with st.container(horizontal=True, width=width):
                for quantity in row:
                    _tile(analysis, quantity)


def show_bands(analysis: Analysis) -> None:
    """The frequencies of every motion that the answer uses."""
    lines = analysis.fit.phasors
    labels, hz = np.array(lines.labels), lines.omega / (2 * np.pi)
    bands = []
    for index, record in enumerate(analysis.study.motion_records, start=1):
        name = record.label or f"motion record {index}"
        own = hz[labels == name]
        if own.size:
            origin = "chosen from its spectrum" if record.band_hz is None else "from the study"
            low, high = significant(own.min(), 3), significant(own.max(), 3)
            bands.append(f"{markdown_escape(name)}: {low}–{high} Hz, {origin}")
    if bands:
        how = "To change it, set band_hz of the record in study.toml."
        st.caption(f"Band of the motions: {'; '.join(bands)}. {how}")


def _values_table(analysis: Analysis, own: Sequence[Quantity]) -> dict[str, list[str]]:
    """One row per joint, for many joints: K of all of them, or D."""
    name = own[0].parameter
    columns: dict[str, list[str]] = {"Joint": [f"{q.joints[0]}" for q in own]}
    columns[f"{name} ({own[0].unit})"] = [quantity.shown[0] for quantity in own]
    if analysis.nominal is not None:
        columns[f"Nominal {name}"] = [_nominal(analysis, quantity) for quantity in own]
    return columns


def _nominal(analysis: Analysis, found: Quantity) -> str:
    """Nominal value with its change, empty without one."""
    if analysis.nominal is None:
        return ""
    reference = float(analysis.nominal[found.place])
    change = f" ({change_from(found.value, found.error, reference)})".replace(" (–)", "")
    return unbroken(plain(float(f"{reference:.5g}")) + change)


def _tile(analysis: Analysis, found: Quantity) -> None:
    assumed = f"nominal {text}" if (text := _nominal(analysis, found)) else None
    st.metric(
        found.heading,
        found.shown[0],
        assumed,
        delta_color="off",
        delta_arrow="off",
        border=True,
        width=_TILE_WIDTH,
        help=f"{capitalised(found.meaning)} {analysis.unit.side}. {ERROR_BARS} {_NOMINAL}",
    )


def show_findings(page: Page, analysis: Answer) -> None:
    """At most three findings, most important first; the others on demand.

    That of an unusable answer is in the headline.
    """
    findings = analysis.findings[analysis.state == NOT_USABLE :]
    for finding in findings[:_MOST_FINDINGS]:
        _finding(page, analysis, finding)
    if rest := findings[_MOST_FINDINGS:]:
        with st.expander(counted(len(rest), "more finding")):
            for finding in rest:
                _finding(page, analysis, finding)


def _is_fault(finding: Finding) -> bool:
    """Whether the answer is better with the change; a note states what the fit includes anyway."""
    return finding.level in ("problem", "warning")


def _finding(page: Page, analysis: Answer, finding: Finding, lead: str = "") -> None:
    box = _BOXES[finding.level]
    advice = f"*{markdown_escape(finding.remedy)}*  \n" if finding.remedy else ""
    lead = f"{lead}\n\n" if lead else f"**{markdown_escape(finding.title)}.** "
    as_last = bool(finding.changes) and _is_fault(finding)
    after = "" if as_last else f"  \n{advice}"
    box(unbroken(f"{lead}{markdown_escape(finding.detail)}{after}"))
    offer_changes(page, analysis, finding)
    if as_last and advice:
        st.expander("If this is not the cause").markdown(advice)
    is_own = page.key not in workspace.sample_paths()
    if finding.action and is_own and st.session_state.get(OPEN_LOGS):  # else the import is empty
        step, part = ACTIONS[finding.action]
        workspace.link_to(step, f"{step.name}: {part}")


def freed_note(analysis: Analysis) -> str:
    """Explain "without friction" in a figure's legend, if present."""
    removed = removed_effects(analysis)
    words = in_legend(removed)
    meaning = "data with the identified effects removed" if words == removed else f"{removed}, as fitted"
    return f' "{capitalised(words)}": {meaning}.' if words else ""


def show_steps() -> None:
    """Links to the steps of the method."""
    for step in METHOD:
        name, line = st.columns([1, 5], vertical_alignment="center", gap=None)
        workspace.link_to(step, f"**{step.name}**", name)
        line.caption(step.line)  # a link's label is cut off where it is too long for a phone
