"""The pieces of the page about the cut, and the small one for the first screen."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

import numpy as np
import streamlit as st

from jointid import Analysis, Elasticity, JointIdError
from jointid.arrays import Floats
from jointid.cut.outcome import EVERYDAY_SERVO, Outcome, millimetres
from jointid.cut.robot import CutFriction, CutRobot
from jointid.cut.servo import Servo
from jointid.cut.tolerance import ToleranceMap, tolerance_map
from jointid.figures.cut_shapes import Shape, window
from jointid.figures.cut_tolerance import tolerance_heatmap
from jointid.figures.style import colours
from jointid.rounding import significant
from jointid.ui.cut import cached_cuts as cut_cached
from jointid.ui.cut.pictures import key_line, picture
from jointid.ui.cut.settings import CutSettings
from jointid.ui.shared.background import awaited, run_in_background
from jointid.ui.shared.charts import plot
from jointid.ui.shared.messages import show_note, show_warning
from jointid.ui.shared.page import Page
from jointid.ui.shared.results import result_cache
from jointid.wording import counted

CUT_PAGE = "pages/5_Cut.py"
_WIDE = 21
_RANGES = ("± 10 %", "A factor of 3", "This identification's uncertainty")


def show_rule(robot: CutRobot) -> None:
    """Say whose robot cuts."""
    (st.caption if robot.rule == "direct" else st.info)(robot.meaning)


def headline(outcome: Outcome) -> str:
    """Path error before and after, and whose it is."""
    if outcome.robot.rule == "demonstration":
        return "A demonstration, not this study"
    whose = " of the example arm" if outcome.robot.rule == "relative" else ""
    return f"Path error{whose} {millimetres(outcome.before_m)} → {millimetres(outcome.after_m)}"


def show_meaning(outcome: Outcome, settings: CutSettings) -> None:
    """What the two path errors are."""
    if outcome.distribution is None:
        show_warning(f"What the identification promises is not known. {outcome.problem}")
    after = millimetres(outcome.after_m)
    st.caption(
        "Path error is the largest distance of the tool from the wanted path, simulated.\n"
        f"- **Before, {millimetres(outcome.before_m)}**: {_robot(outcome.robot)} "
        f"{_servo(outcome)}\n"
        f"- **After, {after}**: {promise(outcome, settings)}\n"
        f"- **Both**: {_conditions(settings)}"
    )
    if outcome.before.torque_limit_hit or outcome.after.torque_limit_hit:
        st.warning("A motor torque was cut off at its limit.")


def _robot(robot: CutRobot) -> str:
    """Whose springs the robot before has."""
    springs = _springs(robot.elasticity)
    if robot.rule == "demonstration":
        return f"the example arm with the paper's springs, {springs}."
    if robot.rule != "relative":
        return f"a robot with the identified springs, {springs}."
    own, factor = robot.of_the_study(robot.elasticity), _three(robot.scale)
    return (
        f"the example arm with the identified springs scaled by {factor}: {springs}, where this study's "
        f"robot has {_springs(own)}."
    )


def _servo(outcome: Outcome) -> str:
    """What the servo before assumes."""
    robot, assumed = outcome.robot, outcome.assumed
    if assumed is None:
        return "Its servo takes the joints as rigid."
    text = f"Its servo assumes {_springs(assumed)}"
    if robot.rule == "relative":
        text += f", which stands for {_springs(robot.of_the_study(assumed))} on this study's robot"
    return text + "."


def _springs(elasticity: Elasticity) -> str:
    return f"K = {_three(elasticity.K)} N·m/rad, D = {_three(elasticity.D)} N·m·s/rad"


def remainder(
    outcome: Outcome,
    servo: Servo,
    friction: CutFriction | None,
    where: str = "the table at the end says",
) -> str:
    """Say what remains where the springs are known better than this cut can show.

    Parameters
    ----------
    outcome : Outcome
        One whose error does not depend on how well the springs are known.
    servo : Servo
        The controller of this cut.
    friction : CutFriction or None
        At the motors.
    where : str
        Where errors of K and their cost stand, from the place of this sentence.
    """
    left = millimetres(outcome.after_m)
    if left.startswith("under"):
        return f"What remains, {left}, is below what the simulation resolves."
    causes = []
    if friction is not None and servo.friction_compensation is None:
        causes.append("friction")
    if servo.delay_samples:
        causes.append("delay")
    if servo.encoder_bits is not None:
        causes.append("encoder")
    *first, last = causes or ["the controller's rate"]
    named = f"{', '.join(first)} and {last}" if first else last
    return (
        f"What remains, {left}, is {named}, not the springs: within the noise of the fit it changes by "
        f"{millimetres(outcome.spread_m)}, and its 95 % point is shown. Inertias that are off move K by "
        f"more: {where} what an error of K costs."
    )


def promise(outcome: Outcome, settings: CutSettings) -> str:
    """What the path error after the identification is."""
    if outcome.distribution is None:
        return "a robot with exactly the identified springs; how far they are off is not known."
    if not outcome.springs_matter:
        return (
            f"the servo assumes the identified values. "
            f"{remainder(outcome, settings.servo, settings.friction)}{_less_before(outcome)}"
        )
    return (
        "the servo assumes the identified values, and the robot differs from them as far as their "
        f"uncertainty allows. 95 of 100 such robots stay {_below(outcome.after_m)}, half of them "
        f"{_below(outcome.distribution.median_m)}."
    )


def _less_before(outcome: Outcome) -> str:
    """Why the cut before may have the smaller error."""
    if outcome.before_m >= outcome.after_m:
        return ""
    return (
        " That the error before is smaller is chance: there the wrong springs cancel a part of what "
        "remains."
    )


def _conditions(settings: CutSettings) -> str:
    """Controller and friction, the same before and after."""
    encoder = f"{settings.encoder_bits}-bit encoders" if settings.encoder_bits else "ideal encoders"
    delay = counted(settings.delay_samples, "sample")
    text = f"a controller of {settings.rate_hz:g} Hz with a delay of {delay} and {encoder}; "
    if settings.friction is None:
        return text + "motors without friction."
    what = f"motors with a Coulomb friction of {_three(settings.friction.coulomb)} N·m, which the servo "
    if settings.compensated:
        return text + what + "compensates."
    return text + what + "does not compensate: that leaves an error of its own."


def _below(length_m: float) -> str:
    text = millimetres(length_m)
    return text if text.startswith("under") else f"below {text}"


def _three(values: Iterable[float]) -> str:
    """Values with three digits."""
    return ", ".join(significant(float(value), 3) for value in values)


def show_tolerance(page: Page, settings: CutSettings, outcome: Outcome) -> None:
    """Cost of some errors of K̂, and on demand a map of a few hundred cuts."""
    cut = settings.after  # neither depends on the nominal controller
    begun = cut_cached.offset_costs(page.digest, page.method, cut, outcome.robot)
    awaited("Cutting", begun)
    exact, *off = begun.result()[0].tolist()
    costs = [exact, *(max(pair) for pair in zip(off[::2], off[1::2], strict=True))]  # the worse sign
    heads = ["exact", *(f"± {100 * offset:g} %" for offset in cut_cached.OFFSETS)]
    st.markdown(
        f"| K̂ off by, both joints alike | {' | '.join(heads)} |\n|{' --- |' * (len(heads) + 1)}\n"
        f"| costs (path error, the worse sign) | {' | '.join(map(millimetres, costs))} |"
    )
    chosen = st.segmented_control(
        "Range of K̂/K",
        _RANGES,
        default=_RANGES[0],
        required=True,
        key="cut_map_range",
        bind="query-params",
    )
    span = chosen or _RANGES[0]
    key = ("tolerance map", page.digest, page.method, cut, span)
    tolerance: ToleranceMap | None = result_cache().get(key)
    if tolerance is None:
        place = st.empty()
        if not place.button(
            f"Compute the map ({_WIDE * _WIDE} cuts)",
            key="cut_map",
            help="Takes a few seconds. Later visits with the same settings show it at once.",
        ):
            return
        with place.container():
            bar = st.progress(0.0, "Cutting")
            st.button("Stop", key="cut_map_stop", help="Ends the computation; nothing is kept of it.")

        def show(done: float) -> None:
            bar.progress(min(done, 1.0), f"Cutting: {done:.0%}")

        robot = outcome.robot
        ratios = [_ratios(robot, joint, span) for joint in (0, 1)]
        tolerance = run_in_background(
            tolerance_map,
            robot.arm,
            outcome.toolpath,
            robot.elasticity,
            *ratios,
            servo=settings.servo,
            friction=settings.friction,
            progress=show,
        )
        result_cache().put(key, tolerance)
        place.empty()
    robot = outcome.robot
    plot(
        tolerance_heatmap(
            tolerance, robot.elasticity, robot.covariance, outcome.assumed, dark=page.dark
        ),
        "Largest path error over the ratios of assumed to true stiffness",
        key="cut_map_figure",
    )
    path_error = tolerance.max_contour_error_m
    st.caption(
        f"Errors on this map: {millimetres(path_error.min())} to {millimetres(path_error.max())}."
    )


def _ratios(robot: CutRobot, joint: int, span: str) -> Floats:
    """K̂/K within 10 %, from 1/3 to 3, or as far as four standard errors."""
    if span == _RANGES[2]:
        error = float(np.sqrt(robot.covariance[joint, joint]) / robot.elasticity.K[joint])
        most = 1 + float(np.clip(4 * error, 1e-5, 2.0))
    else:
        most = 3.0 if span == _RANGES[1] else 1 / 0.9
    return np.geomspace(1 / most, most, _WIDE)


def outcome_panel(page: Page, analysis: Analysis) -> None:
    """Path error before and after with a small picture of the cut, for the first screen."""
    try:
        outcome = cut_cached.overview(page.digest, page.method, analysis)
    except JointIdError as error:
        show_note(f"What this is worth on a path is not known. {error}")
        return
    if outcome is None:
        st.page_link(CUT_PAGE, label="What knowing K and D is worth in millimetres, on an example arm")
        return
    ink = colours(page.dark)
    before, after = millimetres(outcome.before_m), millimetres(outcome.after_m)
    servo = "nominal values" if outcome.assumed is not None else "joints taken as rigid"
    shapes = [
        Shape(outcome.before.wanted_m, outcome.before.tool_m, ink.nominal),
        Shape(outcome.after.wanted_m, outcome.after.tool_m, ink.identified),
    ]
    around = window([run.tool_m for run in (outcome.before, outcome.after)], 0.002)
    what = f"Cut with {servo} (path error {before}) and with identified values ({after})"
    with st.container(border=True):
        left, words = st.columns([1, 4], vertical_alignment="center")
        left.html(picture(shapes, what, around, "max-width:9rem"))
        with words:
            st.subheader(headline(outcome), anchor=False)
            st.html(
                f"{key_line(ink.nominal)}{escape(servo)}, {escape(before)}<br>"
                f"{key_line(ink.identified)}identified values, {escape(after)}"
            )
            relative = outcome.robot.rule == "relative"
            arm = (
                "the example arm, because this robot's geometry is not known. It has this study's "
                "springs scaled to its own; ratios and uncertainties are this study's"
                if relative
                else "an arm of these inertias, simulated"
            )
            friction = " Both have the friction that was found." if outcome.robot.friction else ""
            promised = "The uncertainty of the identified values is too large to promise anything."
            if not outcome.springs_matter:
                promised = remainder(
                    outcome, EVERYDAY_SERVO, outcome.robot.friction, "the page Cut says"
                )
            elif outcome.distribution is not None:
                promised = (
                    "95 of 100 robots within the uncertainty of the identified values stay "
                    f"{_below(outcome.after_m)}."
                )
            st.caption(f"A rectangle of 28 × 45 mm at 300 mm/s, cut by {arm}. {promised}{friction}")
            st.page_link(CUT_PAGE, label="Watch the cut")
