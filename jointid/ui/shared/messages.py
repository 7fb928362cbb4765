"""Text from files and people on a page: shown unchanged, never read as Markdown.

Whatever a page shows that is not its own prose goes through here, or through ``markdown_escape`` where
it is part of a sentence in Markdown.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from jointid.ui.shared.markdown_escape import markdown_escape

__all__ = [
    "show_error",
    "show_info",
    "show_note",
    "show_progress",
    "show_text_table",
    "show_warning",
]


def show_error(error: object, place: DeltaGenerator | None = None) -> None:
    """Show an error's message, on the page or at a place of it."""
    (place or st).error(markdown_escape(error))


def show_warning(text: object, place: DeltaGenerator | None = None) -> None:
    """Show a warning."""
    (place or st).warning(markdown_escape(text))


def show_info(text: object, place: DeltaGenerator | None = None) -> None:
    """Show an information box."""
    (place or st).info(markdown_escape(text))


def show_note(text: object, place: DeltaGenerator | None = None) -> None:
    """Show a line of small print."""
    (place or st).caption(markdown_escape(text))


def show_progress(share: float, text: object, place: DeltaGenerator) -> None:
    """Show progress; a share outside 0 to 1 is clipped."""
    place.progress(min(max(share, 0.0), 1.0), markdown_escape(text))


def show_text_table(columns: Mapping[str, Sequence[Any]], place: DeltaGenerator | None = None) -> None:
    """Show a small table without a frame of its own; headings and cells are text.

    A column without a heading holds names of quantities.
    """
    escaped = {
        markdown_escape(name or "Quantity"): [*map(markdown_escape, cells)]
        for name, cells in columns.items()
    }
    (place or st).table(escaped, hide_index=True)
