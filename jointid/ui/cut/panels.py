"""Panels of the page Cut, and its summary for the first screen."""

from functools import partial
from html import escape

import numpy as np
import streamlit as st

from jointid import Analysis, Elasticity, JointIdError
from jointid.analysis import NOT_USABLE
from jointid.answer import AT_MOTOR, StiffnessUnit, laws_text
from jointid.cut.outcome import (
    TYPICAL_SERVO,
    ZONES_M,
    Outcome,
    at_most,
    millimetres,
    remaining_error_text,
    with_laws_text,
)
from jointid.cut.path_deflection import (
    COLUMNS_MEANING,
    has_own_path,
    meaning,
    own_path_deflections,
    rows_of,
)
from jointid.cut.robot import CutFriction, CutRobot
from jointid.cut.servo import Servo
from jointid.figures.style import colours
from jointid.ui.cut import cached_cuts
from jointid.ui.cut.pictures import (
    deflection_pictures,
    deflections_html,
    key,
    key_line,
    magnification,
    picture,
    window,
)
from jointid.ui.cut.settings import CutSettings, usual
from jointid.ui.shared.messages import show_note, show_text_table, show_warning
from jointid.ui.shared.method_steps import CUT
from jointid.ui.shared.page import Page
from jointid.ui.shared.workspace import link_to
from jointid.wording import capitalised, chosen, counted, three_digits, unbroken


def show_own_path(page: Page, analysis: Analysis, *, summary: bool = False) -> None:
    """Show how far a robot with a model of its own bends along the path.

    ``summary`` shows the largest corner zone only, for the first screen.
    """
    doing = "Following the path with the robot model"
    try:
        found = page.computed("own path", doing, own_path_deflections, analysis, ZONES_M)
    except JointIdError as error:
        show_note(f"The tool deflection cannot be computed. {error}")
        return
    largest, servo = found[-1], "the nominal K"
    if largest.assumed_m is None:
        servo = "a rigid servo"
    answer = unbroken(
        f"Uncompensated deflection of the tool: {millimetres(largest.before_m)} with {servo}, "
        f"{millimetres(largest.identified_m)} with the identified K"
    )
    found = found[-1:] if summary else found
    times, ink = magnification(found), colours(page.dark)
    names = {servo.split(maxsplit=1)[1]: ink.nominal, "identified K": ink.identified}
    legend = f"{key(names | {'reference path': '#999999'})}<br>Seen from above, deflection × {times}"
    if summary:
        with st.container(border=True):
            left, words = st.columns([1, 4], vertical_alignment="center")
            draw = partial(deflection_pictures, [largest], "max-width:9rem")
            left.html(page.drawn("own path overview", draw)[0][0])
            with words:
                st.header(answer, anchor=False)
                st.html(legend)
                st.caption(f"Corner zone {1e3 * ZONES_M[-1]:g} mm. {meaning(analysis)}")
                link_to(CUT, "All corner zones")
        return
    st.header(answer, anchor=False)
    st.html(legend)
    st.html(page.drawn("own path", partial(deflections_html, found, ZONES_M)))
    header, rows = rows_of([1e3 * zone for zone in ZONES_M], found)
    show_text_table(dict(zip(map(capitalised, header), zip(*rows, strict=True), strict=True)))
    st.caption(f"{meaning(analysis)} {COLUMNS_MEANING}")


def headline(outcome: Outcome) -> str:
    """Path error before and after, and its robot."""
    if outcome.robot.rule == "demonstration":
        return "A demonstration, not this study's robot"
    whose = " of the example arm:" if outcome.robot.rule == "relative" else ""
    errors = f"{millimetres(outcome.before_m)} → {millimetres(outcome.after_m)}"
    return unbroken(f"Path error{whose} {errors} ({outcome.which})")


def show_meaning(outcome: Outcome, settings: CutSettings, analysis: Analysis) -> None:
    """State which robot cuts, and explain the two path errors."""
    (st.caption if outcome.robot.rule == "direct" else st.info)(outcome.robot.meaning)
    if outcome.distribution is None:
        show_warning(f"The path error after the identification cannot be computed. {outcome.problem}")
    before, after = millimetres(outcome.before_m), millimetres(outcome.after_m)
    st.caption(
        "Path error: largest simulated distance of the tool from the reference path.\n"
        f"- **Before, {before}**: {_robot(outcome.robot, analysis)} "
        f"{_servo(outcome, analysis.unit)}\n"
        f"- **After, {after}**: the servo assumes the identified values. "
        f"{accuracy_text(outcome, settings.servo, settings.friction, 'The tab Accuracy of K')}\n"
        f"- **Both**: {_conditions(settings)}"
    )


def _robot(robot: CutRobot, analysis: Analysis) -> str:
    """K and D of the robot before the identification; those of the study as on its tiles."""
    if robot.rule == "demonstration":
        return f"the example arm with the paper's {_values(robot.elasticity, AT_MOTOR)}."
    found, n, unit = [q.shown[0] for q in analysis.quantities], analysis.fit.n, analysis.unit
    own = _with_units(", ".join(found[:n]), ", ".join(found[n:]), unit)
    if robot.rule != "relative":
        return f"a robot with the identified {own}."
    return (
        f"the example arm with the identified values scaled by {three_digits(robot.scale)}: "
        f"{_values(robot.elasticity, AT_MOTOR)}, where this study's robot has {own}."
    )


def _of_the_arm(robot: CutRobot, unit: StiffnessUnit) -> StiffnessUnit:
    """Unit of K and D of the arm that cuts: that of the study, if they are its own."""
    return unit if robot.rule in ("direct", "springs") else AT_MOTOR


def _servo(outcome: Outcome, unit: StiffnessUnit) -> str:
    """Assumptions of the servo before the identification."""
    robot, assumed = outcome.robot, outcome.assumed
    if assumed is None:
        return "Its servo assumes rigid joints."
    text = f"Its servo assumes {_values(assumed, _of_the_arm(robot, unit))}"
    if robot.rule == "relative":
        own = _values(robot.of_the_study(assumed), unit)
        text += f", which corresponds to {own} on this study's robot"
    return text + "."


def _values(elasticity: Elasticity, unit: StiffnessUnit) -> str:
    K, D = np.split(unit.shown(np.concatenate([elasticity.K, elasticity.D])), 2)
    return _with_units(chosen(K), chosen(D), unit)


def _with_units(K: str, D: str, unit: StiffnessUnit) -> str:
    side = "" if unit.is_default else f" {unit.side}"
    return f"K = {K} N·m/{unit.angle}, D = {D} N·m·s/rad{side}"


def accuracy_text(
    outcome: Outcome,
    servo: Servo,
    friction: CutFriction | None,
    where: str = "The page Cut, tab Accuracy of K,",
) -> str:
    """Explain the path error after the identification; ``where`` an error of K is examined."""
    if outcome.distribution is None:
        return "The robot has exactly the identified K and D; their error is not known."
    if not outcome.depends_on_elasticity:
        text = remaining_error_text(outcome, servo, friction)
        return f"{text} {where} shows the effect of an error in K."
    return (
        "K and D of the simulated robot are drawn from the error bars: the path error "
        f"stays {at_most(outcome.after_m)} with a probability of 95 %, "
        f"{at_most(outcome.distribution.median_m)} with 50 %. {outcome.not_better}"
    )


def _conditions(settings: CutSettings) -> str:
    """Servo and friction, the same before and after."""
    servo = settings.servo
    encoder = f"{servo.encoder_bits}-bit encoders" if servo.encoder_bits else "ideal encoders"
    delay = counted(servo.delay_samples, "sample")
    text = f"a servo of {servo.sample_rate_hz:g} Hz with a delay of {delay} and {encoder}; "
    if settings.friction is None:
        return text + "motors without friction."
    action = "compensates it"
    if servo.friction_compensation is None:
        action = "does not compensate it, which adds to the error"
    coulomb = chosen(settings.friction.coulomb)
    return f"{text}motors with a Coulomb friction of {coulomb} N·m. The servo {action}."


def show_assumptions() -> None:
    """Law of the servo, the paper's statements on its cuts, and the assumptions made here."""
    st.write(
        "The gears deflect while the arm accelerates, and the tool leaves its path unless the servo "
        "pre-compensates the deflection x. It computes x from the K̂ and D̂ that it assumes; errors in "
        "these become path errors."
    )
    st.latex(
        r"""\begin{gathered}
        \mathbf u = \mathbf M_2(\mathbf q)\,\ddot{\mathbf q}
            + \mathbf c(\mathbf q, \dot{\mathbf q}) \\
        \hat D_j\,\dot x_j + \hat K_j\,x_j = u_j, \quad \theta_j = q_j + x_j
        \end{gathered}"""
    )
    st.markdown(
        "**The paper states**: rectangles of 28 × 45 mm, cut at 300 mm/s in a horizontal plane with "
        "three corner zones; K = 43, 7.5 N·m/rad and D = 0.10, 0.015 N·m·s/rad seen from the "
        "motors; a largest error of several millimetres with non-optimal parameters at the "
        "largest zone.\n\n"
        "**Assumed here**, not stated in the paper: link lengths, masses, gear ratios "
        "and inertias of the arm (two links of 0.705 and 0.755 m, tool at 1.15 m from the base); "
        "the law by which the servo compensates the deflection, its feedback (10 Hz), rate, delay and "
        "encoders; the sizes of the zones (1, 5 and 10 mm) and how a corner is rounded; an "
        "acceleration of at most 15 m/s² and ramps of at least 50 ms; which parameters were "
        "non-optimal.\n\n"
        "**Both robots are simulated.** In the cut before identification, the robot has the identified "
        "K and D, the best estimate of the real ones; its servo assumes other values. The blue path is "
        "that of the robot at the 95th percentile of the path error. Errors in the inertias act through "
        "K and D; links are rigid."
    )


def show_gears(page: Page, settings: CutSettings, outcome: Outcome) -> None:
    """Show the cut with the identified nonlinear gears by a servo that assumes K and D, or the laws."""
    robot = outcome.robot
    if not robot.gears:
        return
    st.header("With the identified gear laws", anchor=False)
    runs = outcome.after, cached_cuts.with_laws(page, settings.after, robot)
    laws = "; ".join(f"joint {j}: {laws_text(g.laws)}" for j, g in enumerate(robot.gears, start=1))
    ink = colours(page.dark)
    servos = ("Servo assumes K and D", ink.nominal), ("Servo assumes the gear laws", ink.identified)
    around = window(runs)
    for place, run, (servo, colour) in zip(st.columns(2), runs, servos, strict=True):
        error = millimetres(run.max_contour_error_m)
        what = f"{servo}: path error {error}"
        with place.container(border=True, horizontal=True, vertical_alignment="center"):
            st.html(picture([(run, colour)], what, around, "max-width:7rem"))
            st.metric(servo, error)
    st.caption(
        f"Largest path error of a robot with the identified gears ({laws}), as in all cuts of this "
        "page. The first has K and D at the 95th percentile of the path error, the second the "
        "identified K and D. Beyond the torques of the records the laws are extrapolated."
    )


def outcome_panel(page: Page, analysis: Analysis) -> None:
    """Path error before and after with a small picture of the cut, for the first screen."""
    try:
        outcome = cached_cuts.overview(page, analysis)
    except JointIdError as error:
        if analysis.state != NOT_USABLE:  # the headline gives the reason
            show_note(f"The path error cannot be computed. {error}")
        return
    if outcome is None:
        if has_own_path(analysis):
            show_own_path(page, analysis, summary=True)
        else:
            link_to(CUT, "A cut by the example arm, as a demonstration")
        return
    ink = colours(page.dark)
    before, after = millimetres(outcome.before_m), millimetres(outcome.after_m)
    servo = "nominal values" if outcome.assumed is not None else "rigid joints"
    cuts = [(outcome.before, ink.nominal), (outcome.after, ink.identified)]
    around = window([outcome.before, outcome.after])
    what = f"Cut with {servo} (path error {before}) and with identified values ({after})"
    with st.container(border=True):
        left, words = st.columns([1, 4], vertical_alignment="center")
        small = "max-width:9rem"
        left.html(page.drawn("overview", lambda dark: picture(cuts, what, around, small)))
        with words:
            st.header(headline(outcome), anchor=False)
            st.html(
                f"{key_line(ink.nominal)}{escape(servo)}, {escape(before)}: one simulation<br>"
                f"{key_line(ink.identified)}identified values, {escape(after)}: {outcome.which}"
            )
            arm, of = "a simulated arm with this study's inertias", outcome.robot
            parts = {"friction": of.friction, "gear laws": of.gears}
            included = " and ".join(name for name, part in parts.items() if part)
            if of.rule == "relative":
                arm = (
                    "the example arm, because this robot's geometry is not known. Its K and D are "
                    "scaled so that the ratios of nominal to identified values and the relative errors "
                    "equal those of this study"
                )
            accuracy = accuracy_text(outcome, TYPICAL_SERVO, of.friction)
            st.caption(
                "A rectangle of 28 × 45 mm with corner zones of 10 mm at 300 mm/s, cut by "
                f"{arm}. {accuracy}"
                + f" Both simulations include the identified {included}."
                * (bool(included) and "includes the effects" not in accuracy)
            )
            if of.gears:
                run = cached_cuts.with_laws(page, usual(of).after, of)
                st.caption(f"The simulated gears are nonlinear. {with_laws_text(run)}")
            link_to(CUT, "Watch the cut")
