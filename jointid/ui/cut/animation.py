"""The animated cut: a canvas component that runs in the browser without the server."""

from pathlib import Path
from typing import Any

import numpy as np
import streamlit as st

from jointid.arrays import Floats
from jointid.cut.arm import PlanarArm
from jointid.cut.outcome import Outcome, millimetres
from jointid.cut.tracking import TrackingRun
from jointid.figures.style import colours

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
    ink, arm = colours(dark), outcome.robot.arm
    before = f"{nominal_name}: {millimetres(outcome.before_m)}"
    after = f"identified: {millimetres(outcome.after.max_contour_error_m)}"
    return {
        "tracks": tracks(outcome.before, outcome.after),
        "length_m": arm.length_m.tolist(),
        "crank_m": _CRANK_M,
        "serial": arm.drive == "serial",
        "cell_m": _cell(arm, outcome),
        "sheet_m": _sheet(outcome.before),
        "window_m": _window(outcome.before),
        "magnifications": magnifications(outcome),
        "reach_m": [_reach(outcome.before), _reach(outcome.after)],
        "room_m": _room(outcome.before),
        "nominal": ink.nominal,
        "identified": ink.identified,
        "nominal_name": nominal_name,
        "description": f"Tool paths over the reference path. Largest path error, {before}; {after}.",
    }


def tracks(before: TrackingRun, after: TrackingRun) -> Any:
    """Time, reference, nominal and identified position, both contour errors: (frames, 9), float32."""
    frames = max(2, int(np.ceil(before.time_s[-1] / _FRAME_S)) + 1)
    time = np.linspace(0.0, before.time_s[-1], frames)
    columns = [time]
    for track, run in ((before.wanted_m, before), (before.tool_m, before), (after.tool_m, after)):
        columns += [np.interp(time, run.time_s, track[:, axis]) for axis in (0, 1)]
    columns += [np.interp(time, run.time_s, run.contour_error_m) for run in (before, after)]
    return np.stack(columns, axis=1).astype(np.float32)


def magnifications(outcome: Outcome) -> list[int]:
    """Factors by which errors may be magnified while the smaller one leaves its shape recognisable."""
    smaller = min(_reach(outcome.before), _reach(outcome.after))
    room = _room(outcome.before)
    return [factor for factor in _MAGNIFICATIONS if factor == 1 or factor * smaller <= room]


def _reach(run: TrackingRun) -> float:
    """Largest distance of the tool from its reference at the same time, m."""
    return run.max_tracking_error_m


def _room(run: TrackingRun) -> float:
    """Largest magnified error that is drawn, m: the shape stays recognisable and within the window."""
    side = float(np.ptp(run.wanted_m, axis=0).min())
    return min(_RECOGNISABLE * side, _margin(run))


def _margin(run: TrackingRun) -> float:
    return _MARGIN_M + 1.2 * min(run.max_contour_error_m, 0.03)


def _window(run: TrackingRun) -> list[float]:
    """Window of the cut's view: the reference path with room for the error; x, y, width, height in m."""
    return _box(run.wanted_m, _margin(run))


def _sheet(run: TrackingRun) -> list[float]:
    low, high = run.wanted_m.min(axis=0), run.wanted_m.max(axis=0)
    side = max(_SHEET_M, float((high - low).max()) + 0.08)
    x, y = 0.5 * (low + high) - 0.5 * side
    return [float(x), float(y), side, side]


def _cell(arm: PlanarArm, outcome: Outcome) -> list[float]:
    """Window of the arm's view: base, elbow with crank, and sheet."""
    first, second = arm.link_angles(outcome.before.joint_angle_rad[0])
    elbow = arm.length_m[0] * np.array([np.cos(first), np.sin(first)])
    back = -_CRANK_M * np.array([np.cos(second), np.sin(second)])
    x, y, width, height = _sheet(outcome.before)
    corners = [[x, y], [x + width, y + height]]
    return _box(np.array([[0.0, 0.0], elbow, back, elbow + back, *corners]), 0.08)


def _box(points: Floats, margin: float) -> list[float]:
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    return [*low.tolist(), *(high - low).tolist()]
