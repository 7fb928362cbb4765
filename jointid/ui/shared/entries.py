"""Entries that outlive a refresh: what differs from the default is kept in the address."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

T = TypeVar("T")
Number = TypeVar("Number", int, float)


def _kept(key: str, ask: Callable[..., T], default: T, label: str, *args: Any, **settings: Any) -> T:
    """Draw a widget; on the way back from another page, which clears its address, restore its value."""
    kept: dict[str, Any] = st.session_state.setdefault("kept entries", {})
    if kept.get(key, default) != default and key not in {*st.session_state, *st.query_params}:
        st.session_state[key] = kept[key]
        settings.pop("value", None)  # streamlit warns of two initial values
    kept[key] = value = ask(label, *args, key=key, bind="query-params", **settings)
    return value


def enter_text(
    place: DeltaGenerator, key: str, label: str, value: str, help_: str = "", example: str = ""
) -> str:
    """Ask for a text."""
    ask = place.text_input
    return _kept(key, ask, value, label, value=value, help=help_ or None, placeholder=example)


def enter_number(
    place: DeltaGenerator,
    key: str,
    label: str,
    value: Number,
    limits: tuple[Number, Number],
    help_: str = "",
) -> Number:
    """Ask for a number within limits."""
    ask, shown = place.number_input, "%d" if isinstance(value, int) else "%g"
    return _kept(key, ask, value, label, *limits, value=value, format=shown, help=help_ or None)


def choose_from(
    place: DeltaGenerator,
    key: str,
    label: str,
    options: Sequence[str],
    format_func: Callable[[str], str] = str,
) -> str:
    """Ask for one of several options, at first the first."""
    return _kept(key, place.selectbox, options[0], label, options, format_func=format_func)


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
