"""Text that comes from files or people, as it stands: Streamlit takes nearly every text for Markdown."""

from __future__ import annotations

import re

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

__all__ = ["literal", "show_error", "show_info", "show_note", "show_warning"]

_JOINER = "\N{WORD JOINER}"
"""Invisible. Addresses, icons and arrows are sought in the finished text, where no backslash helps."""
_ALWAYS = re.compile(r"[\\`*\[\]<$|~&]")
_UNDERSCORES = re.compile(r"(?<![^\W_])_+|_+(?![^\W_])")
_DIRECTIVE = re.compile(r":(?=[^\W\d_]|[:{])")
_FIRST = re.compile(r"^([-+=#>]|\d+(?=[.)]))")
_SOUGHT = (
    re.compile(r"(?i)(?<=https:)(?=//)|(?<=http:)(?=//)|(?<=www)(?=\.)"),
    re.compile(r"(?<=@)(?=[-\w])"),
    re.compile(r"(?<=:)(?=(?:material/)?[-+\w]+:)"),
    re.compile(r"(?<=\s[-<>=~])(?=[->=]+(?:\s|$))|(?<=^[-<>=~])(?=[->=]+(?:\s|$))"),
)


def literal(text: object) -> str:
    """Return Markdown that shows a text as it stands; its lines stay lines.

    Parameters
    ----------
    text : object
        Anything; what ``str`` makes of it.

    Returns
    -------
    str
        No emphasis, link, image, address to click, formula, icon, colour or HTML comes of it. What
        Markdown would leave alone is left alone: names such as theta_m1_rad, numbers and units.
    """
    lines = (_line(line.strip()) for line in str(text).splitlines())
    return "  \n".join(line for line in lines if line)


def show_error(error: object, place: DeltaGenerator | None = None) -> None:
    """Show an error's message as it stands, on the page or in a place of it."""
    (place or st).error(literal(error))


def show_warning(text: object, place: DeltaGenerator | None = None) -> None:
    """Show a warning as it stands."""
    (place or st).warning(literal(text))


def show_info(text: object, place: DeltaGenerator | None = None) -> None:
    """Show something to know, as it stands."""
    (place or st).info(literal(text))


def show_note(text: object, place: DeltaGenerator | None = None) -> None:
    """Show a line of small print as it stands."""
    (place or st).caption(literal(text))


def _line(text: str) -> str:
    for pattern in _SOUGHT:
        text = pattern.sub(_JOINER, text)
    text = _ALWAYS.sub(r"\\\g<0>", text)
    text = _UNDERSCORES.sub(lambda found: "\\_" * len(found[0]), text)
    text = _DIRECTIVE.sub(r"\\:", text)
    return _FIRST.sub(_first, text)


def _first(found: re.Match[str]) -> str:
    """What begins a heading, a quotation or a list at the beginning of a line."""
    return f"{found[0]}{_JOINER}" if found[0].isdigit() else f"\\{found[0]}"
