"""Changes that may remedy a finding: offered, previewed, made and taken back."""

from dataclasses import replace

import numpy as np
import streamlit as st

from jointid import Analysis, Finding, JointIdError, Study
from jointid.corrections.changes import corrected, label
from jointid.files.digest import study_digest
from jointid.files.store import Store
from jointid.ui.shared.messages import show_error, show_note, show_text_table
from jointid.ui.shared.page import Page
from jointid.ui.shared.workspace import (
    change_store,
    keep,
    keep_part,
    names_by_address,
    noting_problems,
    place_for,
    recent,
    store,
)
from jointid.verdict.evidence import Change
from jointid.wording import UNDETERMINED, significant

_PREVIEWED, _BEFORE = "previewed_change", "study_before_change"
_SUFFIX = ", corrected"
_PART = "corrections"


def show_changes(page: Page) -> None:
    """List the changes of the data as logged, with a way back."""
    if not page.study.changes:
        return
    with st.container(border=True):
        show_note(f"Changed from the data as logged: {' '.join(page.study.changes)}")
        before = _before(page.digest)
        if before in names_by_address():
            st.button("Undo the last change", key="undo_change", on_click=_undo, args=(before,))


def offer_changes(page: Page, analysis: Analysis, finding: Finding) -> None:
    """Offer the changes that may remedy a finding, and the answer with the one being looked at."""
    if not finding.changes:
        return
    texts = [label(page.study, change) for change in finding.changes]
    with st.container(horizontal=True):
        for text in texts:
            chosen = (page.digest, text)
            st.button(f"Fix it: {text}", key=f"fix {text}", on_click=_look_at, args=(chosen,))
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
            st.caption("The residuals in the finding are those of a quick check without friction.")
        show_note(after.headline)
        with st.container(horizontal=True):
            st.button(
                "Apply",
                key="apply_change",
                type="primary",
                on_click=_apply,
                args=(page, study),
                help="Makes a new study with this change. The current one stays in the list.",
            )
            st.button("Cancel", key="cancel_change", on_click=_look_at, args=(None,))


def _compared(before: Analysis, after: Analysis) -> dict[str, list[str]]:
    columns = {"": ["State"]}
    columns[""] += [f"{found.name} ({found.unit})" for found in before.quantities]
    columns[""] += ["Residual of the whole model / noise"]
    for heading, each in (("Now", before), ("With the change", after)):
        misfit = float(np.sqrt(each.fit.misfit))
        columns[heading] = [
            each.state,
            *(found.shown[0] for found in each.quantities),
            significant(misfit, 2) if np.isfinite(misfit) else UNDETERMINED,
        ]
    return columns


def _look_at(chosen: tuple[str, str] | None) -> None:
    st.session_state[_PREVIEWED] = chosen


def _apply(page: Page, study: Study) -> None:
    """Keep the corrected study and show it; the workspace remembers its origin."""
    digest, before = study_digest(study), str(st.session_state["chosen"])
    keep(study, page.key.removesuffix(_SUFFIX) + _SUFFIX)
    with noting_problems("The change can be undone in this session only. "):
        keep_part(_PART, lambda to, place: _note_before(to, place, digest, before))
    st.session_state.setdefault(_BEFORE, {})[digest] = before
    _look_at(None)


def _note_before(to: Store, place: str, digest: str, before: str) -> None:
    to.put(place, "Study before a change", digest, before.encode())


def _before(digest: str) -> str | None:
    """Key of the study that a changed one was made from, read once per session."""
    known: dict[str, str | None] = st.session_state.setdefault(_BEFORE, {})
    if digest not in known:
        known[digest] = None
        with noting_problems():
            if place := place_for(_PART):
                found = [entry.id for entry in store().entries(place) if entry.digest == digest]
                known[digest] = store().read(place, found[0]).decode() if found else None
    return known[digest]


def _undo(before: str) -> None:
    """Show the study before the change, and remove the changed one."""
    if (changed := st.session_state["chosen"]) in {entry.id for entry in recent().values()}:
        change_store("delete", changed)
    st.session_state["chosen"] = before
