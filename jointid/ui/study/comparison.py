"""Panels of the page Compare."""

from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np
import streamlit as st

from jointid import Analysis, JointIdError, Study
from jointid.analysis import NOT_USABLE, WITH_CARE, Answer
from jointid.figures import compared_responses
from jointid.ui.shared.entries import choose_from
from jointid.ui.shared.messages import markdown_escape, show_error, show_info, show_note, show_text_table
from jointid.ui.shared.method_steps import OVERVIEW
from jointid.ui.shared.page import Page
from jointid.ui.shared.settings import ESTIMATORS
from jointid.ui.shared.workspace import label, link_to, names_by_address, open_study, sample_paths
from jointid.uncertainty.comparison import (
    INDEPENDENT_ERRORS,
    Difference,
    comparable,
    compare,
    comparison_sentence,
    values_shown,
)
from jointid.wording import enumerated, significant, unbroken

_MOST_PARTNERS = 10
"""The newest own studies are considered as partners; every one is read."""
_SHARED = "Both come from the same records and share their noise: the difference has no standard error."


def choose_other(page: Page) -> Page:
    """Ask for the second study and its estimator; end the page where it cannot be opened."""
    addresses = {name: address for address, name in names_by_address().items()}
    partner = _partner(page)
    st.caption("The sidebar selects the first study and its estimator.")
    left, right, beside = st.columns([5, 5, 2], vertical_alignment="bottom")
    second = "compare_study", "Second study", list(addresses)
    key = choose_from(left, *second, label, first=partner)
    # Without a partner, the paper's estimator is compared.
    alone = partner == page.key and page.method != "least-squares"
    paper = "least-squares" if alone else None
    question = "compare_estimator", "Its estimator", list(ESTIMATORS)
    method = choose_from(right, *question, help_="See the sidebar.", first=paper)
    swapped = {"chosen": addresses[key], "estimator": method}
    swapped |= {"compare_study": page.key, "compare_estimator": page.method}
    hint = "The second study becomes the first."
    beside.button("Swap", on_click=st.session_state.update, args=(swapped,), help=hint)
    try:
        opened = open_study(key)
    except JointIdError as error:
        show_error(error)
        st.stop()
    return replace(page, key=opened.key, study=opened.study, digest=opened.digest, method=method)


def _partner(page: Page) -> str:
    """Name of the best partner of as many joints, else of the chosen study.

    Own studies are paired with own ones and samples with samples, where there are any; among them the
    same robot comes first, with records of the same kind, then the newest or the list's order.
    """
    names, samples = names_by_address().values(), sample_paths()
    own = [name for name in names if name not in samples]
    found: dict[str, tuple[bool, ...]] = {}
    for name in [*own[:_MOST_PARTNERS], *samples]:
        with suppress(JointIdError):
            study = open_study(name).study
            if name != page.key and study.inertia.n == page.study.inertia.n:
                other_kind = bool(study.motion_records) != bool(page.study.motion_records)
                is_mixed = (name in samples) != (page.key in samples)
                found[name] = is_mixed, not _same_robot(page.study, study), other_kind
    return min(found, key=lambda name: found[name], default=page.key)


def _same_robot(one: Study, other: Study) -> bool:
    """Whether two studies of as many joints name one robot or, without names, have equal rotors."""
    if one.robot and other.robot:
        return one.robot == other.robot
    return np.allclose(one.inertia.M, other.inertia.M, rtol=0.02, atol=0.0)


def answer_of_second(other: Page) -> Answer:
    """Return the result of the second study; without one, show whose it is and why, and end the page."""
    try:
        other.answered()
    except JointIdError as error:
        show_error(f"Second study, {other.label}: {error}")
        st.stop()
    return other.answer()


def show_differences(page: Page, first: Answer, other: Page, second: Answer) -> None:
    """The answer in a sentence, and K and D of both with their differences."""
    same = page.digest == other.digest
    units = first.unit, second.unit
    try:
        first, second = comparable(first, second)
        rows = compare(first.quantities, second.quantities, same_records=same)
    except JointIdError as error:
        show_error(error)
        st.stop()
    if same and first.fit.method == second.fit.method:  # for sensors, whatever the estimators
        show_info("Both sides show the same study and estimator: choose another study or estimator.")
        st.stop()
    pairs = ((page, first), (other, second))
    unusable = [pair for pair in pairs if pair[1].state == NOT_USABLE]
    if not unusable:
        names = [p.method if same else _quoted(p) for p, _ in pairs]
        states = zip(names, (each.state for _, each in pairs), strict=True)
        doubts = [f"{name} is usable with care only" for name, state in states if state == WITH_CARE]
        unstated = not (first.torque_stated and second.torque_stated)
        sentence = _sentence(rows, page, other, exact_torque_scales=unstated)
        said = [sentence, *([enumerated(doubts)] if doubts else [])]
        st.header(unbroken(", but ".join(said)), anchor=False)
    for whose, each in unusable:
        show_error(f'"{whose.label}": {each.headline[0].lower()}{each.headline[1:]}')
        address = next(address for address, name in names_by_address().items() if name == whose.key)
        hint = f"{_quoted(whose)}: findings and remedies"
        link_to(OVERVIEW, hint, study=address, estimator=whose.method)
    show_note(
        f'First: "{page.label}", {_estimator(first, page)}, {first.state}. '
        f'Second: "{other.label}", {_estimator(second, other)}, {second.state}.'
    )
    columns = {"": [f"{row.first.name} ({row.first.unit})" for row in rows]}
    if not unusable:
        columns["Difference"] = [row.change for row in rows]
        if not same:  # else the difference has no standard error
            columns["Significant"] = [row.significance for row in rows]
    names = [
        name + ", not usable" * (one.state == NOT_USABLE)
        for name, (_, one) in zip(("First", "Second"), pairs, strict=True)
    ]
    columns[names[0]] = values_shown((row.first for row in rows), usable=first.state != NOT_USABLE)
    columns[names[1]] = values_shown((row.second for row in rows), usable=second.state != NOT_USABLE)
    show_text_table(columns)
    other_unit = "" if units == (first.unit, second.unit) else ", the side that both studies have"
    what = "K and D" if isinstance(first, Analysis) and isinstance(second, Analysis) else "K"
    caption = f"{what} {first.unit.side}{other_unit}."
    if not unusable:
        caption += " Difference: second study minus first. "
        caption += _SHARED if same else INDEPENDENT_ERRORS
    st.caption(caption)


def show_models(page: Page, first: Answer, other: Page, second: Answer) -> None:
    """Both identified models over both measurements, per joint; those of motors only."""
    if not (isinstance(first, Analysis) and isinstance(second, Analysis)):
        return
    if not (first.transfer_matrices and second.transfer_matrices):
        show_info(first.transfer_problem or second.transfer_problem)
        return
    names = (page.method, other.method) if page.digest == other.digest else ("first", "second")
    st.header("Both models", anchor=False)
    st.caption(
        "Acceleration of each motor over its own torque: models as lines, measurements as points, "
        "without the identified effects such as friction."
    )
    page.show_per_joint(
        f"compare {page.key} {other.key} {other.digest} {other.method}",
        partial(compared_responses, (first, second), names),
        "Magnitude of H{0}{0}, compared",
    )


def _estimator(answer: Answer, page: Page) -> str:
    return f"estimator {page.method}" if isinstance(answer, Analysis) else answer.fit.method


def _sentence(
    rows: tuple[Difference, ...], page: Page, other: Page, *, exact_torque_scales: bool
) -> str:
    if page.digest == other.digest:
        largest = max(abs(row.relative) for row in rows if row.first.parameter == "K")
        between = f"between {page.method} and {other.method}"
        return f"The stiffnesses differ by up to {significant(100 * largest, 2)} % {between}"
    names = _quoted(page), _quoted(other)
    return comparison_sentence(rows, *names, exact_torque_scales=exact_torque_scales)


def _quoted(page: Page) -> str:
    """The name of a study within a sentence; it may hold commas."""
    return f'"{markdown_escape(page.label)}"'
