"""Cuts, computed once for each study and settings."""

from __future__ import annotations

import streamlit as st

from jointid import Analysis, Elasticity
from jointid.cut.outcome import ZONES_M, Outcome, Promise, promised, with_promise
from jointid.cut.robot import CutRobot, assumed_elasticity, cut_robot
from jointid.cut.tolerance import ToleranceMap, errors_of_mismatch
from jointid.cut.tracking import TrackingRun, track
from jointid.ui.aside import aside
from jointid.ui.cut_settings import CutSettings, usual

MapKey = tuple[str, str, CutSettings, str]
OFFSETS = (0.01, 0.03, 0.10)
"""Errors of K̂ whose cost is said in figures."""
_MOST_MAPS = 60


def outcome(digest: str, method: str, settings: CutSettings, analysis: Analysis) -> Outcome:
    """Cut before and after, with the path error that the identification promises.

    Another nominal controller cuts anew before, another zone both; what stays the same is kept.
    """
    robot = cut_robot(analysis, settings.drive)
    assumed = assumed_elasticity(robot, settings.assumption, settings.custom)
    before = _before(digest, method, settings, robot, assumed)
    promise = _promise(digest, method, settings.after, robot)
    return with_promise(robot, settings.toolpath, assumed, before, promise)


def pair(
    digest: str, method: str, settings: CutSettings, zone_m: float, outcome: Outcome
) -> tuple[TrackingRun, TrackingRun]:
    """Cut before and after with a corner zone of Figure 7, by the robots that cut its largest one.

    So the figure stays as it is while the zone of ``settings`` changes, but where the two are the same.
    """
    if zone_m == settings.zone_m:
        return outcome.before, outcome.after
    there, largest = settings.with_zone(zone_m), settings.with_zone(ZONES_M[-1])
    robot = outcome.robot
    before = _before(digest, method, there, robot, outcome.assumed)
    promise = _promise(digest, method, largest.after, robot)
    if there == largest:
        return before, promise.after
    springs = (*promise.edge.K.tolist(), *promise.edge.D.tolist())
    return before, _after(digest, method, there.after, springs, robot, promise.edge)


@st.cache_resource(max_entries=512, show_spinner=False)
def _before(
    digest: str, method: str, settings: CutSettings, _robot: CutRobot, _assumed: Elasticity | None
) -> TrackingRun:
    return aside(
        track,
        _robot.arm,
        settings.toolpath,
        _robot.elasticity,
        _assumed,
        servo=settings.servo,
        friction=settings.friction,
    )


@st.cache_resource(max_entries=256, show_spinner="Cutting")
def _promise(digest: str, method: str, settings: CutSettings, _robot: CutRobot) -> Promise:
    return aside(promised, _robot, settings.toolpath, servo=settings.servo, friction=settings.friction)


@st.cache_resource(max_entries=512, show_spinner=False)
def _after(
    digest: str,
    method: str,
    settings: CutSettings,
    springs: tuple[float, ...],
    _robot: CutRobot,
    _edge: Elasticity,
) -> TrackingRun:
    return aside(
        track,
        _robot.arm,
        settings.toolpath,
        _edge,
        _robot.elasticity,
        servo=settings.servo,
        friction=settings.friction,
    )


@st.cache_resource(max_entries=256, show_spinner=False)
def offset_costs(digest: str, method: str, settings: CutSettings, _outcome: Outcome) -> list[float]:
    """Path error with exact K̂, then with each of ``OFFSETS`` in both joints alike, the worse sign; m."""
    ratios = [1.0, *(1 + sign * offset for offset in OFFSETS for sign in (-1, 1))]
    robot = _outcome.robot
    errors, _ = aside(
        errors_of_mismatch,
        robot.arm,
        _outcome.toolpath,
        robot.elasticity,
        ratios,
        servo=settings.servo,
        friction=settings.friction,
    )
    exact, *off = errors.tolist()
    return [exact, *(max(pair) for pair in zip(off[::2], off[1::2], strict=True))]


def overview(digest: str, method: str, analysis: Analysis) -> Outcome | None:
    """What the identification changes on the paper's path; its cuts are shared with the page about them.

    None where no cut applies.

    Raises
    ------
    JointIdError
        As in :func:`jointid.cut.outcome.study_outcome`.
    """
    robot = cut_robot(analysis)
    if robot.rule == "demonstration":
        return None
    return outcome(digest, method, usual(robot), analysis)


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
