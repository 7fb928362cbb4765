"""Entries that outlive a refresh: what differs from the default is kept in the address."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

T = TypeVar("T")
Number = TypeVar("Number", int, float)


def enter_text(
    place: DeltaGenerator, key: str, label: str, value: str, help_: str = "", example: str = ""
) -> str:
    """Ask for a text."""
    return place.text_input(
        label,
        value,
        key=key,
        help=help_ or None,
        placeholder=example,
        bind="query-params",
        persist_state="session",
    )


def enter_number(
    place: DeltaGenerator,
    key: str,
    label: str,
    value: Number,
    limits: tuple[Number, Number],
    help_: str = "",
) -> Number:
    """Ask for a number within limits."""
    shown = "%d" if isinstance(value, int) else "%g"
    return place.number_input(
        label,
        *limits,
        value,
        format=shown,
        key=key,
        help=help_ or None,
        bind="query-params",
        persist_state="session",
    )


def choose_from(
    place: DeltaGenerator,
    key: str,
    label: str,
    options: Sequence[str],
    format_func: Callable[[str], str] = str,
) -> str:
    """Ask for one of several options, at first the first."""
    return place.selectbox(label, options, key=key, format_func=format_func, bind="query-params")


def applied(label: str, key: str, settings: T, *, at_first: bool = False) -> T | None:
    """Draw a button; return the settings as they were when it was last clicked.

    Parameters
    ----------
    label, key : str
    settings : T
        As they are entered now.
    at_first : bool
        Whether the settings apply before the first click; otherwise None is returned until then.
    """
    kept = f"applied {key}"
    if st.button(label, type="primary", key=f"apply {key}") or (
        at_first and kept not in st.session_state
    ):
        st.session_state[kept] = settings
    found: T | None = st.session_state.get(kept)
    return found
