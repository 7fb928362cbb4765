"""Introductions, figures, tables, downloads and choices, as every page shows them."""

import re
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from mimetypes import guess_type
from pathlib import Path
from typing import Any, Literal, TypeVar

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from jointid.exporting.tables import csv_text
from jointid.files.application import application_folder
from jointid.wording import file_stem

_ENTRY = re.compile(r"^\*\*(.+?)\*\*: .*(?:\n.+)*", re.MULTILINE)
_SYMBOL = re.compile(r" [A-ZησJ][\w, ]*$")


@cache
def glossary() -> str:
    """Return the glossary of the documentation in Markdown, without its heading."""
    page = application_folder() / "docs" / "reference" / "glossary.md"
    return page.read_text("utf-8").partition("\n")[2]


def introduce(text: str) -> None:
    """Write a text; its hint explains the terms of the glossary that occur in it."""
    st.markdown(text, help=_hint(text))


@cache
def _hint(text: str) -> str | None:
    entries = [entry[0] for entry in _ENTRY.finditer(glossary()) if _occurs(entry[1], text)]
    return "\n\n".join([*entries, "More terms: page Glossary."]) if entries else None


def _occurs(term: str, text: str) -> bool:
    """Whether one of the names of a term, without its symbols, occurs in a text."""
    names = "|".join(map(re.escape, _SYMBOL.sub("", term).split(", ")))
    return re.search(rf"\b({names})s?\b", text, re.IGNORECASE) is not None


T = TypeVar("T")
_WIDE = 8
"""Columns of a table that is wider than the page."""
_MOST_SEGMENTS = 8
FEW_JOINTS = 3
"""Joints up to which a page shows all of them; of more, it asks for one."""
Table = Mapping[str, Sequence[Any]]
"""Columns by their heading."""
NO_POSE = "as in [inertia]"
"""Label of records without a pose."""


def is_dark() -> bool:
    """Whether the browser shows the dark theme."""
    return st.context.theme.type == "dark"


_scripts = {
    name: st.components.v2.component(
        f"jointid_{name}",
        html="<i hidden></i>",
        js=Path(__file__).with_name(f"{name}.js").read_text("utf-8"),
    )
    for name in ("back_button", "figure_toolbar", "scroll_regions", "phone_sidebar")
}


def equip_page() -> None:
    """Equip the Back button, toolbars of figures with SVG and CSV, scrolling regions, phones."""
    for name, script in _scripts.items():
        script(key=name)


def plot(figure: Any, description: str, *, key: str | None = None) -> None:
    """Show a plotly figure over the full width, with a text for those who cannot see it.

    The toolbar on hover saves it as PNG, SVG and CSV, and resets the axes.
    """
    settings = {
        "displaylogo": False,
        "displayModeBar": "hover",
        "modeBarButtons": [["toImage", "zoom2d", "pan2d", "resetScale2d"]],
        "toImageButtonOptions": {"filename": file_stem(description), "scale": 2},
        "scrollZoom": False,
    }
    st.plotly_chart(figure, config=settings, theme=None, alt=description, key=key)


def side_by_side(count: int) -> list[DeltaGenerator]:
    """Return places for ``count`` figures: two in a row, on a phone one."""
    if count == 1:
        return [st.container()]
    rows = [st.columns(2) for _ in range(-(-count // 2))]
    return [place for row in rows for place in row][:count]


def show_tabs(key: str, panels: Mapping[str, Callable[[], object]]) -> None:
    """Show panels as tabs by their names; only the open one is computed, and the address keeps it."""
    tabs = st.tabs([*panels], key=key, bind="query-params")
    for tab, show in zip(tabs, panels.values(), strict=True):
        if tab.open:
            with tab:
                show()


def table(
    columns: Table, *, height: int | None = None, exact: str = "", phone: Sequence[str] = (), **more: Any
) -> None:
    """Show a table that scrolls within its own frame; a wide one keeps its first column in view.

    ``exact`` is the column whose numbers keep all their digits; the others have four decimals. On a
    phone only the columns ``phone`` are shown, by default all. ``more`` are arguments of the wide one.
    """
    first = next(iter(columns))
    fitting = min(36 + 35 * len(columns[first]), height or 430)
    wide = len(columns) > _WIDE
    settings: dict[str, Any] = {first: st.column_config.Column(pinned=True)} if wide else {}
    if exact:
        settings[exact] = st.column_config.NumberColumn(format="%.15g", pinned=wide or None)
    about: dict[str, Any] = {"hide_index": True, "height": fitting, "column_config": settings}
    if not phone:
        st.dataframe(dict(columns), **about)
        return
    # page.css shows one of them by the width of the window, which the server does not know.
    shown = {"wide": columns, "narrow": {name: columns[name] for name in phone}}
    for width, each in shown.items():
        with st.container(key=f"{width} table {' '.join(columns)}"):
            st.dataframe(dict(each), **about | (more if width == "wide" else {}))


def choose_segment(
    label: str,
    options: Sequence[T],
    key: str,
    *,
    format_func: Callable[[T], str] = str,
    hint: str | None = None,
) -> T:
    """Ask for one of a few options side by side, of many in a list; the address keeps the choice.

    At first the first one is chosen.
    """
    about: dict[str, Any] = {"key": key, "bind": "query-params", "help": hint}
    ask: Callable[..., T] = st.selectbox
    if len(options) <= _MOST_SEGMENTS:
        ask, about = st.segmented_control, about | {"default": options[0], "required": True}
    return ask(label, options, format_func=format_func, **about)


def choose_joint(joints: Sequence[int], key: str) -> int:
    """Ask for one of several joints, counted from 0."""
    return choose_segment("Joint", joints, key, format_func=lambda j: f"Joint {j + 1}")


def download(
    label: str,
    data: str | bytes | Callable[[], str | bytes],
    file_name: str,
    *,
    kind: Literal["primary", "secondary"] = "secondary",
    hint: str | None = None,
) -> None:
    """Draw a button that saves a file and leaves the page as it is; its name states its type."""
    mime, _ = guess_type(file_name)
    key = f"save {label}"
    st.download_button(label, data, file_name, mime, key=key, help=hint, on_click="ignore", type=kind)


def csv_of(columns: Table) -> str:
    """Return a table as CSV, numbers to the last bit."""
    return csv_text(columns, zip(*columns.values(), strict=True))
