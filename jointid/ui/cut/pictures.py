"""Pictures of cuts: the animation, a canvas component, and Figure 7 of the paper."""

from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import streamlit as st

from jointid import TrackingRun
from jointid.arrays import Floats
from jointid.cut.arm import PlanarArm
from jointid.cut.outcome import Outcome, millimetres
from jointid.cut.path_deflection import PathDeflection
from jointid.figures.style import LIGHT, colours
from jointid.reporting.cut_animation import animated_cut
from jointid.reporting.drawing import Drawing, Line, to_svg
from jointid.reporting.figures import cut_figure
from jointid.ui.cut import cached_cuts
from jointid.ui.cut.settings import CutSettings
from jointid.ui.shared.charts import download
from jointid.ui.shared.page import Page
from jointid.wording import capitalised

_HERE = Path(__file__).parent
_FRAME_S = 1e-3
"""Time between two frames of data; the browser interpolates."""
_MARGIN_M = 0.006
_SHEET_M = 0.16
_CRANK_M = 0.18
"""Length of the crank by which motor 2 of a parallelogram drive turns link 2; drawn only."""

_MAGNIFICATIONS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
_RECOGNISABLE = 0.3
"""A magnified error may reach this share of the path's shorter side; beyond, the shape is lost."""
_DRAWN = 0.15
"""The same for a still picture, where the paths before and after stay apart from the opposite side."""

_component = st.components.v2.component(
    "jointid_cut",
    html=(_HERE / "arm_animation.html").read_text("utf-8"),
    css=(_HERE / "arm_animation.css").read_text("utf-8"),
    js=(_HERE / "arm_animation.js").read_text("utf-8"),
)


def show_animation(outcome: Outcome, nominal_name: str, *, dark: bool) -> None:
    """Show both cuts as one animation; ``nominal_name`` is that of the controller before."""
    _component(key="cut_animation", data=animation_data(outcome, nominal_name, dark=dark))


def animation_data(outcome: Outcome, nominal_name: str, *, dark: bool) -> dict[str, Any]:
    """Return the component's data; tracks as float32, sent as Arrow."""
    ink, arm, path = colours(dark), outcome.robot.arm, outcome.before.reference_m
    before = f"{nominal_name}: {millimetres(outcome.before_m)}"
    after = f"identified: {millimetres(outcome.after.max_contour_error_m)}"
    low, high = path.min(axis=0), path.max(axis=0)
    side = max(_SHEET_M, float((high - low).max()) + 0.08)
    sheet = [*(0.5 * (low + high) - 0.5 * side).tolist(), side, side]
    reach, room, margin = _reach_and_room(outcome)
    return {
        "tracks": tracks(outcome.before, outcome.after),
        "length_m": arm.length_m.tolist(),
        "crank_m": _CRANK_M,
        "serial": arm.drive == "serial",
        "cell_m": _cell(arm, outcome.before, sheet),
        "sheet_m": sheet,
        "window_m": _box(path, margin),
        "magnifications": [f for f in _MAGNIFICATIONS if f == 1 or f * min(reach) <= room],
        "reach_m": reach,
        "room_m": room,
        "nominal": ink.nominal,
        "identified": ink.identified,
        "nominal_name": nominal_name,
        "description": f"Tool paths over the reference path. Largest path error, {before}; {after}.",
    }


def _reach_and_room(outcome: Outcome) -> tuple[list[float], float, float]:
    """Largest distances from the reference, how far they may be drawn, and the margin for them, m."""
    margin = _MARGIN_M + 1.2 * min(outcome.before.max_contour_error_m, 0.03)
    reach = [run.max_tracking_error_m for run in (outcome.before, outcome.after)]
    side = float(np.ptp(outcome.before.reference_m, axis=0).min())
    return reach, min(_RECOGNISABLE * side, margin), margin


def animated_svg(outcome: Outcome, nominal: str, study: str) -> str:
    """The animation as a file to hand on, magnified as at first."""
    reach, room, _ = _reach_and_room(outcome)
    return animated_cut(
        (outcome.before, outcome.after),
        (capitalised(nominal), "Identified"),
        (LIGHT.nominal, LIGHT.identified),
        times=_largest_magnification(max(reach), room),
        title=f"Cut of {study or 'a study'}",
    )


def tracks(before: TrackingRun, after: TrackingRun) -> Any:
    """Time, reference, nominal and identified position, both contour errors: (frames, 9), float32."""
    frames = max(2, int(np.ceil(before.time_s[-1] / _FRAME_S)) + 1)
    time = np.linspace(0.0, before.time_s[-1], frames)
    columns = [time]
    for track, run in ((before.reference_m, before), (before.tool_m, before), (after.tool_m, after)):
        columns += [np.interp(time, run.time_s, track[:, axis]) for axis in (0, 1)]
    columns += [np.interp(time, run.time_s, run.contour_error_m) for run in (before, after)]
    return np.stack(columns, axis=1).astype(np.float32)


def _cell(arm: PlanarArm, run: TrackingRun, sheet: list[float]) -> list[float]:
    """Window of the arm's view: base, elbow with crank, and sheet."""
    first, second = arm.link_angles(run.joint_angle_rad[0])
    elbow = arm.length_m[0] * np.array([np.cos(first), np.sin(first)])
    back = -_CRANK_M * np.array([np.cos(second), np.sin(second)])
    x, y, width, height = sheet
    corners = [[x, y], [x + width, y + height]]
    return _box(np.array([[0.0, 0.0], elbow, back, elbow + back, *corners]), 0.08)


def _box(points: Floats, margin: float) -> list[float]:
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    return [*low.tolist(), *(high - low).tolist()]


_WIDTH, _STRIDE, _AROUND_M = 190.0, 4, 0.002
_ROW = "display:grid;grid-template-columns:repeat(3,minmax(0,1fr));gap:0.75rem;max-width:44rem"
_COLUMN = "min-width:0;text-align:center;font-size:0.9rem;line-height:1.35"


def show_figure_7(page: Page, settings: CutSettings, outcome: Outcome, nominal: str) -> None:
    """Three corner zones, nominal above, identified below, with the picture as a file."""
    st.caption(
        "As in Figure 7 of the paper. In a larger zone the tool passes the corner faster; in zones "
        "up to about 10 mm this deflects the gears more. Grey: reference path; below each shape: "
        "largest path error."
    )
    pairs = cached_cuts.pairs(page, settings, outcome)
    names = (nominal, "identified")
    what = f"figure 7 {replace(settings, zone_m=0.0)}"  # it has zones of its own
    st.html(page.drawn(what, partial(_figure_7_html, pairs, names)))
    done = {f"zone {1e3 * zone:g} mm": runs for zone, runs in pairs if not isinstance(runs, str)}
    if not done:
        return
    figure = partial(cut_figure, [capitalised(name) for name in names], done)
    title = f"Cuts of {page.study.name or 'a study'}"
    with st.container(horizontal=True):
        download("Save the figure (.svg)", lambda: to_svg(figure(), title=title), "cuts.svg")
        download(
            "Save the animation (.svg)",
            lambda: animated_svg(outcome, nominal, page.study.name),
            "cut_animated.svg",
            hint="The chosen corner zone in slow motion, for a browser or a presentation.",
        )


def _figure_7_html(pairs: cached_cuts.Pairs, names: tuple[str, str], *, dark: bool) -> str:
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
            f'<div style="{_ROW}">'
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


def key(lines: Mapping[str, str]) -> str:
    """Meanings with their colours in one line, which breaks between them."""
    return " ".join(
        f'<span style="display:inline-block;margin-right:1em">{key_line(colour)}{escape(name)}</span>'
        for name, colour in lines.items()
    )


def key_line(colour: str) -> str:
    """A short line of this colour before its meaning."""
    return (
        f'<span style="display:inline-block;width:1.4em;border-top:2.5px solid {colour};'
        'vertical-align:middle;margin-right:0.45em"></span>'
    )


def picture(
    runs: Sequence[tuple[TrackingRun, str]],
    description: str,
    around: list[float],
    style: str = "",
) -> str:
    """Cuts in their colours as an image element: inline SVG does not pass streamlit's cleaning."""
    tracks = [(run.tool_m, colour) for run, colour in runs]
    return _image(cut_drawing(runs[0][0].reference_m, tracks, around, description), style)


def _image(drawing: Drawing, style: str) -> str:
    data = b64encode(to_svg(drawing).encode()).decode()
    return (
        f'<img src="data:image/svg+xml;base64,{data}" alt="{escape(drawing.description)}" '
        f'style="width:100%;{style}">'
    )


def magnification(found: Sequence[PathDeflection]) -> int:
    """Factor by which the deflections of a robot along its paths are drawn."""
    largest = max(float(np.linalg.norm(each.before_error_m, axis=1).max()) for each in found)
    room = _DRAWN * float(np.ptp(found[0].reference_m, axis=0).min())
    return _largest_magnification(largest, room)


def _largest_magnification(error_m: float, room_m: float) -> int:
    """Largest factor at which an error stays within the room; 1 if none does."""
    return max((f for f in _MAGNIFICATIONS if f * error_m <= room_m), default=1)


def deflection_pictures(
    found: Sequence[PathDeflection], style: str = "", *, dark: bool
) -> list[tuple[str, str]]:
    """Paths of a robot with a model of its own from above, magnified, each with its largest errors."""
    times, ink = magnification(found), colours(dark)
    drawn = [
        [
            (each.reference_m + times * each.before_error_m[:, :2], ink.nominal),
            (each.reference_m + times * each.after_error_m[:, :2], ink.identified),
        ]
        for each in found
    ]
    around = _box(np.concatenate([track for tracks in drawn for track, _ in tracks]), _AROUND_M)
    pictures = []
    for each, tracks in zip(found, drawn, strict=True):
        errors = f"{millimetres(each.before_m)} → {millimetres(each.identified_m)}"
        what = f"Path of the tool from above, deflection × {times}: {errors}"
        drawing = cut_drawing(each.reference_m, tracks, around, what, stride=1)
        pictures.append((_image(drawing, style), errors))
    return pictures


def deflections_html(found: Sequence[PathDeflection], zones_m: Sequence[float], *, dark: bool) -> str:
    """One picture per corner zone in a row, with its deflections below."""
    parts = []
    for zone, (image, errors) in zip(zones_m, deflection_pictures(found, dark=dark), strict=True):
        label = f"<b>{errors}</b><br>zone {1e3 * zone:g} mm"
        parts.append(f'<div style="{_COLUMN}">{image}<br>{label}</div>')
    return f'<div style="{_ROW}">{"".join(parts)}</div>'


def cut_drawing(
    reference_m: Floats,
    tracks: Sequence[tuple[Floats, str]],
    around: list[float],
    description: str,
    *,
    stride: int = _STRIDE,
) -> Drawing:
    """Paths of the tool, shape (k, 2), m, each with its colour, over the reference path."""
    x, y, width, height = around
    scale = _WIDTH / width
    drawn = [
        (reference_m, "#999999", 5.0, 0.55),
        *((track, colour, 2.0, 1.0) for track, colour in tracks),
    ]
    lines = [
        Line((track[::stride] - (x, y + height)) * (scale, -scale), colour, size, opacity=opacity)
        for track, colour, size, opacity in drawn
    ]
    return Drawing(_WIDTH, height * scale, tuple(lines), description)


def window(runs: Sequence[TrackingRun]) -> list[float]:
    """Box around cuts and their reference path: x, y, width and height, m."""
    paths = [path for run in runs for path in (run.reference_m, run.tool_m)]
    return _box(np.concatenate(paths), _AROUND_M)
