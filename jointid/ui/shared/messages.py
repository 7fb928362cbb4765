"""Text from files and people on a page: shown unchanged, never read as Markdown.

Whatever a page shows that is not its own prose goes through here, or through ``markdown_escape`` where
it is part of a sentence in Markdown.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from jointid.ui.shared.markdown_escape import markdown_escape


def _message(kind: str) -> Callable[..., None]:
    def show(text: object, place: DeltaGenerator | None = None) -> None:
        """Show a text on the page or at a place of it."""
        getattr(place or st, kind)(markdown_escape(text))

    return show


show_error, show_warning, show_info, show_note = map(_message, ("error", "warning", "info", "caption"))


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
