"""Cuts, computed once for each study and settings."""

from collections.abc import Callable, Hashable
from concurrent.futures import Future
from typing import TypeVar

import streamlit as st

from jointid import Analysis, Elasticity, JointIdError
from jointid.arrays import Floats
from jointid.cut.outcome import ZONES_M, Outcome, Prediction, gear_cuts, predicted_cut
from jointid.cut.path_deflection import PathDeflection, own_path_deflections
from jointid.cut.robot import CutRobot, assumed_elasticity, cut_robot
from jointid.cut.tolerance import errors_of_mismatch
from jointid.cut.tracking import TrackingRun, track
from jointid.ui.cut.settings import CutSettings, usual
from jointid.ui.shared.background import awaited, run_in_background
from jointid.ui.shared.results import result_cache

Found = TypeVar("Found")
OFFSETS = (0.01, 0.03, 0.10)
"""Relative errors of K̂ in the table of path errors."""


def outcome(digest: str, method: str, settings: CutSettings, analysis: Analysis) -> Outcome:
    """Cut before and after, with the path error that the identification promises.

    A new nominal controller recomputes the cut before, a new zone both; the rest is kept.
    """
    robot = cut_robot(analysis, settings.drive)
    assumed = assumed_elasticity(robot, settings.assumption, settings.custom)
    before = _before(digest, method, settings, robot, assumed)
    prediction = _prediction(digest, method, settings.after, robot)
    awaited("Cutting", before, prediction)
    return Outcome(robot, settings.toolpath, assumed, before.result(), *prediction.result())


def pairs(
    digest: str, method: str, settings: CutSettings, outcome: Outcome
) -> list[tuple[float, tuple[TrackingRun, TrackingRun] | str]]:
    """Cuts before and after with the corner zones of Figure 7, or their error message."""
    robot, own = outcome.robot, settings.zone_m
    others = [settings.with_zone(zone) for zone in ZONES_M if zone != own]
    befores = {there.zone_m: _before(digest, method, there, robot, outcome.assumed) for there in others}
    afters = {there.zone_m: _prediction(digest, method, there.after, robot) for there in others}
    awaited("Cutting", *befores.values(), *afters.values())
    found: list[tuple[float, tuple[TrackingRun, TrackingRun] | str]] = []
    for zone in ZONES_M:
        try:
            if zone == own:
                runs = outcome.before, outcome.after
            else:
                runs = befores[zone].result(), afters[zone].result().after
            found.append((zone, runs))
        except JointIdError as error:
            found.append((zone, str(error)))
    return found


def _before(
    digest: str, method: str, settings: CutSettings, robot: CutRobot, assumed: Elasticity | None
) -> Future[TrackingRun]:
    key = ("before", digest, method, settings)
    return _begin(key, settings, track, robot.arm, robot.elasticity, assumed)


def _prediction(digest: str, method: str, settings: CutSettings, robot: CutRobot) -> Future[Prediction]:
    return _begin(("prediction", digest, method, settings), settings, predicted_cut, robot)


def gears(
    digest: str, method: str, settings: CutSettings, robot: CutRobot
) -> tuple[TrackingRun, TrackingRun]:
    """Cuts of a robot with nonlinear gears, by servos that know K and D, and their laws."""
    found = _begin(("gears", digest, method, settings), settings, gear_cuts, robot)
    awaited("Cutting", found)
    return found.result()


def offset_costs(
    digest: str, method: str, settings: CutSettings, robot: CutRobot
) -> Future[tuple[Floats, Floats]]:
    """Begin to cut with exact K̂, then with each of ``OFFSETS`` in both joints alike, both signs."""
    ratios = [1.0, *(1 + sign * offset for offset in OFFSETS for sign in (-1, 1))]
    key = ("offsets", digest, method, settings)
    return _begin(key, settings, errors_of_mismatch, robot.arm, robot.elasticity, ratios)


def _begin(
    key: Hashable, settings: CutSettings, compute: Callable[..., Found], who: object, *springs: object
) -> Future[Found]:
    """Begin a computation on a cut; ``result()`` raises for settings that allow none."""
    try:
        path, servo = settings.toolpath, settings.servo
    except JointIdError as error:
        refused: Future[Found] = Future()
        refused.set_exception(error)
        return refused
    options = {"servo": servo, "friction": settings.friction}
    return result_cache().begin(key, compute, who, path, *springs, **options)


def overview(digest: str, method: str, analysis: Analysis) -> Outcome | None:
    """Return the outcome on the paper's path; its cuts are shared with the page Cut.

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


@st.cache_resource(max_entries=32, show_spinner="Following the path with the robot's model")
def own_path(digest: str, method: str, _analysis: Analysis) -> list[PathDeflection]:
    """Deflections of the study's own robot along the path, for each of ``ZONES_M``.

    Raises
    ------
    JointIdError
        As in :func:`jointid.cut.path_deflection.own_path_deflections`.
    """
    return run_in_background(own_path_deflections, _analysis, ZONES_M)
