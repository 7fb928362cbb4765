"""Pictures of cuts: Figure 7 of the paper, and the parts shared with the overview."""

from base64 import b64encode
from collections.abc import Sequence
from functools import partial
from html import escape

import numpy as np
import streamlit as st

from jointid import TrackingRun
from jointid.arrays import Floats
from jointid.cut.outcome import ZONES_M, Outcome, millimetres
from jointid.figures.style import LIGHT, colours
from jointid.reporting.drawing import Drawing, Line, to_svg
from jointid.reporting.figures import cut_figure
from jointid.ui.cut import cached_cuts
from jointid.ui.cut.settings import CutSettings
from jointid.ui.shared.charts import download
from jointid.ui.shared.page import Page
from jointid.wording import capitalised

_WIDTH, _STRIDE, _MARGIN_M = 190.0, 4, 0.002
_COLUMN = "min-width:0;text-align:center;font-size:0.9rem;line-height:1.35"


def show_figure_7(page: Page, settings: CutSettings, outcome: Outcome, nominal: str) -> None:
    """Three corner zones, nominal above, identified below, with the picture as a file."""
    st.caption(
        "As Figure 7 of the paper. In larger zones the tool passes the corner faster and the springs "
        "deflect more. Grey: reference path; below each shape: largest path error."
    )
    pairs = cached_cuts.pairs(page, settings, outcome)
    names = (nominal, "identified")
    own = settings if settings.zone_m in ZONES_M else settings.with_zone(0.0)
    html = page.drawn(f"figure 7 {own}", partial(_figure_7_html, pairs, names))
    st.html(html)
    done = [(zone, runs) for zone, runs in pairs if not isinstance(runs, str)]
    if not done:
        return
    rows = [
        (capitalised(name), colour, [(f"zone {1e3 * zone:g} mm", runs[row]) for zone, runs in done])
        for row, (name, colour) in enumerate(zip(names, (LIGHT.nominal, LIGHT.identified), strict=True))
    ]
    title = f"Cuts of {page.study.name or 'a study'}"
    download("Save the figure (.svg)", lambda: to_svg(cut_figure(rows), title=title), "cuts.svg")


def _figure_7_html(
    pairs: Sequence[tuple[float, tuple[TrackingRun, TrackingRun] | str]],
    names: tuple[str, str],
    *,
    dark: bool,
) -> str:
    """Two rows of pictures in a grid, which keeps its three columns on a phone."""
    every = [run for _, runs in pairs if not isinstance(runs, str) for run in runs]
    if not every:
        return "".join(f"<p>{escape(text)}</p>" for _, text in pairs if isinstance(text, str))
    around, ink = window(every), colours(dark)
    parts = []
    for row, name in enumerate(names):
        colour = ink.identified if row else ink.nominal
        parts.append(
            f'<div style="padding:0.5rem 0 0.25rem">{key_line(colour)}'
            f"<b>{escape(capitalised(name))}</b></div>"
            '<div style="display:grid;grid-template-columns:repeat(3,minmax(0,1fr));gap:0.75rem;'
            'max-width:44rem">'
        )
        for zone, runs in pairs:
            label = f"zone {1e3 * zone:g} mm"
            if isinstance(runs, str):
                parts.append(f'<div style="{_COLUMN}">{label}<br>{escape(runs)}</div>')
                continue
            error = millimetres(runs[row].max_contour_error_m)
            image = picture([(runs[row], colour)], f"{name}, {label}: {error}", around)
            parts.append(f'<div style="{_COLUMN}">{image}<br><b>{error}</b><br>{label}</div>')
        parts.append("</div>")
    return "".join(parts)


def key_line(colour: str) -> str:
    """A short line of this colour before its meaning."""
    return (
        f'<span style="display:inline-block;width:1.4em;border-top:2.5px solid {colour};'
        'vertical-align:middle;margin-right:0.45em"></span>'
    )


def picture(
    runs: Sequence[tuple[TrackingRun, str]],
    description: str,
    around: tuple[float, float, float, float],
    style: str = "",
) -> str:
    """Cuts in their colours as an image element: inline SVG does not pass streamlit's cleaning."""
    tracks = [(run.tool_m, colour) for run, colour in runs]
    svg = to_svg(cut_drawing(runs[0][0].wanted_m, tracks, around, description))
    data = b64encode(svg.encode()).decode()
    return (
        f'<img src="data:image/svg+xml;base64,{data}" alt="{escape(description)}" '
        f'style="width:100%;{style}">'
    )


def cut_drawing(
    wanted_m: Floats,
    tracks: Sequence[tuple[Floats, str]],
    around: tuple[float, float, float, float],
    description: str,
) -> Drawing:
    """Paths of the tool, shape (k, 2), m, each with its colour, over the reference path."""
    x, y, width, height = around
    scale = _WIDTH / width
    drawn = [(wanted_m, "#999999", 5.0, 0.55), *((track, colour, 2.0, 1.0) for track, colour in tracks)]
    lines = [
        Line((track[::_STRIDE] - (x, y + height)) * (scale, -scale), colour, size, opacity=opacity)
        for track, colour, size, opacity in drawn
    ]
    return Drawing(_WIDTH, height * scale, tuple(lines), description)


def window(runs: Sequence[TrackingRun]) -> tuple[float, float, float, float]:
    """Box around cuts and their reference path: x, y, width and height, m."""
    paths = np.concatenate([path for run in runs for path in (run.wanted_m, run.tool_m)])
    low, high = paths.min(axis=0) - _MARGIN_M, paths.max(axis=0) + _MARGIN_M
    return float(low[0]), float(low[1]), float(high[0] - low[0]), float(high[1] - low[1])
