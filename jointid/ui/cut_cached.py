"""Cuts, computed once for each study and settings."""

from __future__ import annotations

import numpy as np
import streamlit as st

from jointid import Analysis
from jointid.cut.outcome import (
    Outcome,
    assumed_elasticity,
    cut_outcome,
    cut_robot,
    study_outcome,
)
from jointid.cut.tolerance import ToleranceMap, tolerance_map
from jointid.cut.tracking import TrackingRun, track
from jointid.ui.cut_settings import CutSettings

MapKey = tuple[str, str, CutSettings, str]
OFFSETS = (0.01, 0.03, 0.10)
"""Errors of K̂ whose cost is said in figures."""
_MOST_MAPS = 12


@st.cache_resource(max_entries=64, show_spinner=False)
def outcome(digest: str, method: str, settings: CutSettings, _analysis: Analysis) -> Outcome:
    """Cut before and after, with the path error that the identification promises."""
    robot = cut_robot(_analysis, settings.drive)
    return cut_outcome(
        robot,
        settings.toolpath,
        assumed_elasticity(robot, settings.assumption, settings.custom),
        servo=settings.servo,
        friction=settings.friction,
    )


@st.cache_resource(max_entries=128, show_spinner=False)
def pair(
    digest: str, method: str, settings: CutSettings, zone_m: float, _outcome: Outcome
) -> tuple[TrackingRun, TrackingRun]:
    """Cut before and after by the robots of an outcome with ``settings``, with another corner zone."""
    if zone_m == settings.zone_m:
        return _outcome.before, _outcome.after
    robot, path = _outcome.robot, settings.with_zone(zone_m).toolpath
    before, after = (
        track(robot.arm, path, true, assumed, servo=settings.servo, friction=settings.friction)
        for true, assumed in ((robot.elasticity, _outcome.assumed), (_outcome.edge, robot.elasticity))
    )
    return before, after


@st.cache_resource(max_entries=64, show_spinner=False)
def offset_costs(digest: str, method: str, settings: CutSettings, _outcome: Outcome) -> list[float]:
    """Path error with exact K̂, then with each of ``OFFSETS`` in both joints alike, the worse sign; m."""
    ratios = [1.0, *(1 + sign * offset for offset in OFFSETS for sign in (-1, 1))]
    robot = _outcome.robot
    tolerance = tolerance_map(
        robot.arm,
        _outcome.toolpath,
        robot.elasticity,
        ratios,
        servo=settings.servo,
        friction=settings.friction,
    )
    exact, *off = np.diag(tolerance.max_contour_error_m).tolist()
    return [exact, *(max(pair) for pair in zip(off[::2], off[1::2], strict=True))]


@st.cache_resource(max_entries=12, show_spinner="Cutting")
def overview(digest: str, method: str, _analysis: Analysis) -> Outcome | None:
    """What the identification changes on the paper's path."""
    return study_outcome(_analysis)


@st.cache_resource(show_spinner=False)
def _maps() -> dict[MapKey, ToleranceMap]:
    return {}


def kept_map(key: MapKey) -> ToleranceMap | None:
    """Return a tolerance map that was computed before."""
    return _maps().get(key)


def keep_map(key: MapKey, tolerance: ToleranceMap) -> None:
    """Keep a tolerance map; a function that shows progress cannot be cached by itself."""
    maps = _maps()
    maps[key] = tolerance
    while len(maps) > _MOST_MAPS:
        maps.pop(next(iter(maps)), None)
