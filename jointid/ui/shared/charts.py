"""How figures and tables are shown."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Any

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

Table = Mapping[str, Sequence[Any]]
"""Columns by their heading."""


def is_dark() -> bool:
    """Whether the browser shows the dark theme."""
    return st.context.theme.type == "dark"


def plot(figure: Any, description: str, *, key: str | None = None) -> None:
    """Show a plotly figure over the full width, with a text for those who cannot see it."""
    settings = {"displaylogo": False, "displayModeBar": False, "scrollZoom": False}
    st.plotly_chart(figure, config=settings, theme=None, alt=description, key=key)


def side_by_side(count: int) -> list[DeltaGenerator]:
    """Return places for ``count`` figures: two beside each other, on a phone one below the other."""
    if count == 1:
        return [st.container()]
    rows = [st.columns(2) for _ in range(-(-count // 2))]
    return [place for row in rows for place in row][:count]


def table(columns: Table, *, height: int | None = None) -> None:
    """Show a table that scrolls within its own frame."""
    rows = len(next(iter(columns.values())))
    fitting = min(36 + 35 * rows, height or 430)
    st.dataframe(dict(columns), hide_index=True, height=fitting)


def csv_bytes(columns: Table) -> bytes:
    """Return a table as CSV, numbers to the last bit."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    return text.getvalue().encode()
