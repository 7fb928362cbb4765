"""Cuts, computed once for each study and settings."""

from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TypeVar

import numpy as np

from jointid import Analysis, Elasticity, JointIdError
from jointid.arrays import Floats
from jointid.cut.outcome import ZONES_M, Outcome, Prediction, cut_before, cut_with_laws, predicted_cut
from jointid.cut.path_errors import errors_of_mismatch
from jointid.cut.robot import CutRobot, assumed_elasticity, cut_robot
from jointid.cut.tracking import TrackingRun
from jointid.ui.cut.settings import CutSettings, usual
from jointid.ui.shared.page import Page
from jointid.ui.shared.results import awaited

Found = TypeVar("Found")
Pairs = list[tuple[float, tuple[TrackingRun, TrackingRun] | str]]
OFFSETS = (0.01, 0.03, 0.10, 0.30)
"""Relative errors of K̂ in the table of path errors."""


def outcome(page: Page, settings: CutSettings, analysis: Analysis) -> Outcome:
    """Cut before and after, with the predicted path error after the identification.

    A new nominal controller recomputes the cut before, a new zone both; the rest is kept.
    """
    robot, assumed, before, prediction = _begun(page, settings, analysis)
    awaited("Simulating the cut", before, prediction)
    return Outcome(robot, settings.toolpath, assumed, before.result(), *prediction.result())


def _begun(
    page: Page, settings: CutSettings, analysis: Analysis
) -> tuple[CutRobot, Elasticity | None, Future[TrackingRun], Future[Prediction]]:
    robot = cut_robot(analysis, settings.drive)
    assumed = assumed_elasticity(robot, settings.assumption, settings.custom)
    return robot, assumed, _before(page, settings, robot, assumed), _after(page, settings, robot)


def pairs(page: Page, settings: CutSettings, outcome: Outcome) -> Pairs:
    """Cuts before and after with the corner zones of Figure 7, or their error message."""
    every = [replace(settings, zone_m=zone) for zone in ZONES_M]
    befores = [_before(page, there, outcome.robot, outcome.assumed) for there in every]
    afters = [_after(page, there, outcome.robot) for there in every]
    awaited("Simulating the cut", *befores, *afters)
    found: Pairs = []
    for zone, before, after in zip(ZONES_M, befores, afters, strict=True):
        try:
            found.append((zone, (before.result(), after.result().after)))
        except JointIdError as error:
            found.append((zone, str(error)))
    return found


def _before(
    page: Page, settings: CutSettings, robot: CutRobot, assumed: Elasticity | None
) -> Future[TrackingRun]:
    return _begin(page, "before", settings, cut_before, robot, assumed)


def _after(page: Page, settings: CutSettings, robot: CutRobot) -> Future[Prediction]:
    return _begin(page, "prediction", settings.after, predicted_cut, robot)


def with_laws(page: Page, settings: CutSettings, robot: CutRobot) -> TrackingRun:
    """Cut of a robot with nonlinear gears whose servo assumes their laws."""
    found = _begin(page, "laws", settings, cut_with_laws, robot)
    awaited("Simulating the cut", found)
    return found.result()


def offset_costs(page: Page, settings: CutSettings, robot: CutRobot) -> tuple[float, Floats]:
    """Path error with exact K̂, and with each of ``OFFSETS`` in both joints, in joint 1 and in joint 2.

    The latter have shape (3, offsets), m, each with the worse sign.
    """
    signs = np.array([[1, 1], [1, 0], [0, 1]])[:, None, None] * np.array([-1, 1])[:, None]
    ratios = 1 + signs * np.array(OFFSETS)[:, None, None]
    pairs = np.concatenate([np.ones((1, 2)), ratios.reshape(-1, 2)]).T
    cut = partial(errors_of_mismatch, gears=robot.laws)
    found = _begin(page, "offsets", settings, cut, robot.arm, robot.elasticity, pairs)
    awaited("Simulating the cut", found)
    errors = found.result()
    return float(errors[0]), errors[1:].reshape(ratios.shape[:-1]).max(axis=-1)


def _begin(
    page: Page,
    what: str,
    settings: CutSettings,
    compute: Callable[..., Found],
    who: object,
    *given: object,
) -> Future[Found]:
    """Begin a computation on a cut; ``result()`` raises for settings that allow none."""
    try:
        path = settings.toolpath
    except JointIdError as error:
        refused: Future[Found] = Future()
        refused.set_exception(error)
        return refused
    options = {"servo": settings.servo, "friction": settings.friction}
    return page.begin((what, settings), compute, who, path, *given, **options)


def begin_overview(page: Page, analysis: Analysis) -> None:
    """Begin the cuts of ``overview``, which shows what prevents them."""
    with suppress(JointIdError):
        if settings := _of_overview(analysis):
            _begun(page, settings, analysis)


def overview(page: Page, analysis: Analysis) -> Outcome | None:
    """Return the outcome on the paper's path; its cuts are shared with the page Cut.

    None where no cut applies. Raises JointIdError as in :func:`jointid.cut.outcome.study_outcome`.
    """
    settings = _of_overview(analysis)
    return None if settings is None else outcome(page, settings, analysis)


def _of_overview(analysis: Analysis) -> CutSettings | None:
    robot = cut_robot(analysis)
    return None if robot.rule == "demonstration" else usual(robot)
