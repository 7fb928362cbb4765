"""The mapping step: the guessed role of each column, with reasons, open to correction."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import streamlit as st

from jointid import JointIdError, importing
from jointid.importing.map.reasons import unchanged
from jointid.ui.importing.entries import Entries
from jointid.ui.importing.files import once
from jointid.ui.shared.charts import download
from jointid.ui.shared.messages import show_error, show_text_table
from jointid.ui.shared.workspace import keep_part, noting_problems, part_entries, read_part
from jointid.wording import capitalised

_SAVED = "import_mappings"
_BASE = "import_base"
_FIRST = "import_first_log"
_WRONG = "import_wrong_entries"
_VERSION = "import version"
_PART = "mappings"
_MOST_KNOWN = 50


def guessed(key: str, table: importing.LogTable) -> importing.Guess:
    """Guess once per log."""
    return once(f"guess {key}", partial(importing.guess_mapping, table))


def mapping_of(key: str, table: importing.LogTable) -> importing.Mapping:
    """Return the mapping that the session has for these columns, or the guess."""
    return _known(table.signature) or guessed(key, table).mapping


def proposed_columns(key: str, table: importing.LogTable) -> tuple[str, ...]:
    """Return time, positions and torques as far as they are known, for the first picture."""
    mapping = mapping_of(key, table)
    names = [name for joint in mapping.joints for name in (joint.position.column, joint.torque.column)]
    return (mapping.time.column, *filter(None, names)) if mapping.time.column else ()


def remember(table: importing.LogTable, mapping: importing.Mapping) -> None:
    """Offer this mapping again for logs with the same columns."""
    st.session_state.setdefault(_SAVED, {})[table.signature] = mapping


def remember_problems(table: importing.LogTable, problems: Sequence[str]) -> None:
    """Remember which entries for logs with these columns cannot be used.

    The mapping of these columns has earlier values, or placeholders, in their place.
    """
    st.session_state.setdefault(_WRONG, {})[table.signature] = [*problems]


def problems_of(tables: Iterable[importing.LogTable], shown: importing.LogTable) -> list[str]:
    """Return what ``remember_problems`` has for these logs; columns not shown are named by a log."""
    wrong: dict[str, list[str]] = st.session_state.get(_WRONG, {})
    of = {table.signature: f"{table.name}: " for table in tables} | {shown.signature: ""}
    return [f"{name}{problem}" for key, name in of.items() for problem in wrong.get(key, [])]


def keep_mapping(table: importing.LogTable, mapping: importing.Mapping) -> None:
    """Offer a mapping that a study was made with in later sessions of this workspace, too."""
    with noting_problems("The mapping is kept in this session only. "):
        stays = [*part_entries(_PART)][-_MOST_KNOWN:]
        data = importing.mapping_to_json(mapping).encode()
        keep_part(_PART, f"The mapping of {table.name}", table.signature, data, beside=stays)


def _known(signature: str) -> importing.Mapping | None:
    """Return the mapping of this session for these columns, at first that of the workspace."""
    known: dict[str, importing.Mapping | None] = st.session_state.setdefault(_SAVED, {})
    if signature not in known:
        known[signature] = None
        with noting_problems("The earlier mapping is no longer available. "):
            if kept := read_part(_PART, signature):
                known[signature] = importing.mapping_from_json(kept)
    return known[signature]


def mappings_to_json() -> dict[str, Any]:
    """Return the mappings of this session as JSON values."""
    parts: dict[str, Any] = {
        key: {k: importing.mapping_to_json(m) for k, m in st.session_state.get(key, {}).items() if m}
        for key in (_SAVED, _BASE)
    }
    return parts | {key: dict(st.session_state.get(key, {})) for key in (_FIRST, _WRONG)}


def mappings_from_json(values: dict[str, Any]) -> None:
    """Restore the result of ``mappings_to_json``.

    Raises JointIdError, KeyError, TypeError or AttributeError when it is something else.
    """
    for key in (_SAVED, _BASE):
        st.session_state[key] = {k: importing.mapping_from_json(text) for k, text in values[key].items()}
    st.session_state[_FIRST] = dict(values[_FIRST])
    st.session_state[_WRONG] = dict(values.get(_WRONG, {}))  # earlier versions wrote none


def entries_of(key: str, table: importing.LogTable) -> tuple[Entries, bool]:
    """Return the entries of a log, and whether they begin as used before for such columns."""
    guess = guessed(key, table)
    bases: dict[str, importing.Mapping] = st.session_state.setdefault(_BASE, {})
    guessed_from: dict[str, str] = st.session_state.setdefault(_FIRST, {})
    known = _known(table.signature)
    base = bases.setdefault(table.signature, known or guess.mapping)
    version = st.session_state.get(_VERSION, 0)
    entries = Entries(table, guess, base, f"{table.signature} {version}")
    return entries, guessed_from.setdefault(table.signature, "" if known else key) != key


def offer_fresh_guess(key: str, table: importing.LogTable) -> None:
    """Show that a mapping is used again, with the way back to the guess."""
    left, right = st.columns([4, 1], vertical_alignment="center")
    left.info("The earlier entries for these columns are used again. Inertias are not reused.")
    if right.button("Guess again", key="guess_afresh"):
        st.session_state[_FIRST][table.signature] = key
        _start_from(table, guessed(key, table).mapping)
        st.rerun()


def of_mapping(key: str) -> bool:
    """Whether a key of the session is that of an entry of a mapping."""
    return any(f" {signature} " in key for signature in st.session_state.get(_BASE, {}))


def offer_again() -> None:
    """Mark every mapping as used before."""
    st.session_state[_FIRST] = dict.fromkeys(st.session_state.get(_FIRST, {}), "")


def show_guesses(key: str, table: importing.LogTable) -> None:
    """List all guesses with their reasons, as ``jointid convert --guess`` does."""
    with st.popover("All guesses with their reasons"):
        reasons = guessed(key, table).reasons
        columns = {"Entry": [capitalised(reason.what) for reason in reasons]}
        columns["Sure"] = ["yes" if reason.sure else "to check" for reason in reasons]
        show_text_table(columns | {"Reason": [reason.text for reason in reasons]})


def mapping_files(key: str, table: importing.LogTable) -> None:
    """Save the mapping as JSON, or take one from a file."""
    with st.popover("Save these entries, or load them from a file"):
        text = importing.mapping_to_json(mapping_of(key, table))
        download("Save the mapping (.json)", text, "mapping.json")
        version = st.session_state.get(_VERSION, 0)
        file = st.file_uploader("Mapping (.json)", ["json"], key=f"import_mapping_file {version}")
        if file is not None:
            try:
                taken = importing.mapping_from_json(file.getvalue())
                for name in taken.columns:
                    table.column(name)
            except JointIdError as error:
                show_error(f"{file.name} was not used: {error}")
            else:
                guess = guessed(key, table).mapping
                _start_from(table, replace(taken, assumed=unchanged(taken, guess)))
                st.rerun()


def _start_from(table: importing.LogTable, mapping: importing.Mapping) -> None:
    st.session_state.setdefault(_BASE, {})[table.signature] = mapping
    version = st.session_state.get(_VERSION, 0)
    for key in [k for k in st.session_state if str(k).endswith(f" {table.signature} {version}")]:
        del st.session_state[key]
    st.session_state[_VERSION] = version + 1
