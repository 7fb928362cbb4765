"""Pictures of cuts: Figure 7 of the paper, and the parts shared with the overview."""

from base64 import b64encode
from collections.abc import Sequence
from html import escape

import streamlit as st

from jointid import TrackingRun
from jointid.cut.outcome import ZONES_M, Outcome, millimetres
from jointid.figures.cut_shapes import Shape, shape_svg, window
from jointid.figures.style import LIGHT, Colours, colours
from jointid.reporting.drawing import to_svg
from jointid.reporting.figures import cut_figure
from jointid.ui.cut import cached_cuts
from jointid.ui.cut.settings import CutSettings
from jointid.ui.shared.page import Page
from jointid.wording import capitalised

_COLUMN = "min-width:0;text-align:center;font-size:0.9rem;line-height:1.35"


def show_figure_7(page: Page, settings: CutSettings, outcome: Outcome, nominal: str) -> None:
    """Three corner zones, nominal above, identified below, with the picture as a file."""
    st.caption(
        "As Figure 7 of the paper. In larger zones the tool passes the corner faster and the springs "
        "deflect more. Grey: reference path; below each shape: largest path error."
    )
    pairs = cached_cuts.pairs(page.digest, page.method, settings, outcome)
    names = (nominal, "identified")
    own = settings if settings.zone_m in ZONES_M else settings.with_zone(0.0)
    html = page.drawn(f"figure 7 {own}", lambda: _figure_7_html(pairs, names, colours(page.dark)))
    st.html(html)
    done = [(zone, runs) for zone, runs in pairs if not isinstance(runs, str)]
    if not done:
        return
    rows = [
        (capitalised(name), colour, [(f"zone {1e3 * zone:g} mm", runs[row]) for zone, runs in done])
        for row, (name, colour) in enumerate(zip(names, (LIGHT.nominal, LIGHT.identified), strict=True))
    ]
    st.download_button(
        "Save the figure (.svg)",
        data=lambda: to_svg(cut_figure(rows), title=f"Cuts of {page.study.name or 'a study'}").encode(),
        file_name="cuts.svg",
        mime="image/svg+xml",
        on_click="ignore",
    )


def _figure_7_html(
    pairs: Sequence[tuple[float, tuple[TrackingRun, TrackingRun] | str]],
    names: tuple[str, str],
    ink: Colours,
) -> str:
    """Two rows of pictures in a grid, which keeps its three columns on a phone."""
    every = [run for _, runs in pairs if not isinstance(runs, str) for run in runs]
    if not every:
        return "".join(f"<p>{escape(text)}</p>" for _, text in pairs if isinstance(text, str))
    around = window([track for run in every for track in (run.wanted_m, run.tool_m)], 0.002)
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
            shape = _shape(zone, runs, row, ink)
            what = f"{name}, {label}: {shape.caption[0]}"
            image = picture([shape], what, around)
            parts.append(f'<div style="{_COLUMN}">{image}<br><b>{shape.caption[0]}</b><br>{label}</div>')
        parts.append("</div>")
    return "".join(parts)


def key_line(colour: str) -> str:
    """A short line of this colour before its meaning."""
    return (
        f'<span style="display:inline-block;width:1.4em;border-top:2.5px solid {colour};'
        'vertical-align:middle;margin-right:0.45em"></span>'
    )


def picture(
    shapes: Sequence[Shape],
    description: str,
    window_m: tuple[float, float, float, float],
    style: str = "",
) -> str:
    """SVG as an image element: inline SVG does not pass streamlit's cleaning of HTML."""
    data = b64encode(shape_svg(shapes, window_m=window_m).encode()).decode()
    return (
        f'<img src="data:image/svg+xml;base64,{data}" alt="{escape(description)}" '
        f'style="width:100%;{style}">'
    )


def _shape(zone: float, runs: tuple[TrackingRun, TrackingRun], row: int, ink: Colours) -> Shape:
    run = runs[row]
    error = millimetres(run.max_contour_error_m)
    colour = ink.identified if row else ink.nominal
    return Shape(run.wanted_m, run.tool_m, colour, (error, f"zone {1e3 * zone:g} mm"))
