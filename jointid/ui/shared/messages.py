"""Text from files and people on a page: shown unchanged, never read as Markdown."""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

_JOINER = "\N{WORD JOINER}"
"""Invisible. Addresses, icons and arrows are sought in the finished text, where no backslash helps."""
_ALWAYS = re.compile(r"[\\`*\[\]<$|~&]")
_UNDERSCORES = re.compile(r"(?<![^\W_])_+|_+(?![^\W_])")
_DIRECTIVE = re.compile(r":(?=[^\W\d_]|[:{])")
_FIRST = re.compile(r"^([-+=#>]|\d+(?=[.)](?:\s|$)))")
_SOUGHT = (
    re.compile(r"(?i)(?<=https:)(?=//)|(?<=http:)(?=//)|(?<=www)(?=\.)"),
    re.compile(r"(?<=@)(?=[-\w])"),
    re.compile(r"(?<=:)(?=(?:material/)?[-+\w]+:)"),
    re.compile(r"(?<=\s[-<>=~])(?=[->=]+(?:\s|$))|(?<=^[-<>=~])(?=[->=]+(?:\s|$))"),
)


def markdown_escape(text: object) -> str:
    """Return Markdown that shows a text, what ``str`` makes of it, unchanged, line by line.

    The result has no emphasis, link, image, address to click, formula, icon, colour or HTML. Text that
    Markdown leaves alone stays unchanged: names such as theta_m1_rad, numbers and units.
    """
    lines = (_line(line.strip()) for line in str(text).splitlines())
    return "  \n".join(line for line in lines if line)


def _line(text: str) -> str:
    for pattern in _SOUGHT:
        text = pattern.sub(_JOINER, text)
    text = _ALWAYS.sub(r"\\\g<0>", text)
    text = _UNDERSCORES.sub(lambda found: "\\_" * len(found[0]), text)
    text = _DIRECTIVE.sub(r"\\:", text)
    return _FIRST.sub(_first, text)


def _first(found: re.Match[str]) -> str:
    """Escape the start of a heading, a quotation or a list."""
    return f"{found[0]}{_JOINER}" if found[0].isdigit() else f"\\{found[0]}"


def _message(kind: str) -> Callable[..., None]:
    def show(text: object, place: DeltaGenerator | None = None) -> None:
        """Show a text on the page or at a place of it."""
        getattr(place or st, kind)(markdown_escape(text))

    return show


show_error, show_warning, show_info, show_note = map(_message, ("error", "warning", "info", "caption"))


def show_text_table(columns: Mapping[str, Sequence[Any]]) -> None:
    """Show a small table without a frame of its own; headings and cells are text.

    A column without a heading holds names of quantities. A narrow cell breaks before "±", not after, and
    not before "mm" and "%".
    """
    escaped = {
        markdown_escape(name or "Quantity"): [
            markdown_escape(cell)
            .replace("± ", "±\N{NO-BREAK SPACE}")
            .replace(" mm", "\N{NO-BREAK SPACE}mm")
            .replace(" %", "\N{NO-BREAK SPACE}%")
            for cell in cells
        ]
        for name, cells in columns.items()
    }
    st.table(escaped, hide_index=True)
