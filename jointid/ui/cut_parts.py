"""The pieces of the page about the cut, and the small one for the first screen."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Sequence
from dataclasses import replace
from html import escape

import numpy as np
import streamlit as st

from jointid import Analysis, JointIdError, TrackingRun
from jointid.arrays import Floats
from jointid.figures.cut import tolerance_heatmap
from jointid.figures.cut_shapes import Shape, shape_svg, shapes_svg, window
from jointid.figures.style import LIGHT, Colours, colours
from jointid.outcome import CutRobot, Outcome, Rule, millimetres
from jointid.rounding import significant
from jointid.tolerance import tolerance_map
from jointid.ui import cut_cached
from jointid.ui.charts import plot
from jointid.ui.cut_settings import CutSettings
from jointid.ui.page import Page

CUT_PAGE = "pages/5_Cut.py"
ZONES_M = (0.001, 0.005, 0.010)
"""Corner zones of Figure 7's three shapes; the paper prints no figures for them."""

_WIDE = 21
_COLUMN = "min-width:0;text-align:center;font-size:0.9rem;line-height:1.35"

_RULES: dict[Rule, str] = {
    "direct": "The inertias of this study are those of the example arm where it cuts, with a {drive} "
    "drive: its K and D apply as they are.",
    "springs": "K and D of this study apply as they are, but its inertias are those of the other drive: "
    "this arm is not the study's robot.",
    "relative": "This study's robot has other inertias than the example arm, and its geometry is not "
    "known. The cut is made by the example arm with the paper's stiffnesses (K = 43, 7.5 N·m/rad); the "
    "ratios of nominal to identified values, D/K, and the relative uncertainties are this study's.",
    "demonstration": "This study has {n} joint(s), and a cut in the plane needs two, so it says nothing "
    "about this study. It shows the paper's values (K = 43, 7.5 N·m/rad, D = 0.10, 0.015 N·m·s/rad) on "
    "the example arm, as if they were known within 1 % and 5 %.",
}


def show_rule(robot: CutRobot, joints: int) -> None:
    """Say whose robot cuts."""
    text = _RULES[robot.rule].format(drive=robot.arm.drive, n=joints)
    if robot.rule == "direct":
        st.caption(text)
    else:
        st.info(text)


def headline(outcome: Outcome) -> str:
    """Path error before and after."""
    return f"Path error {millimetres(outcome.before_m)} → {millimetres(outcome.after_m)}"


def show_meaning(outcome: Outcome, settings: CutSettings) -> None:
    """What the two figures of the headline are."""
    if outcome.distribution is None:
        st.warning(f"What the identification promises is not known. {outcome.problem}")
        promise = "a robot with exactly the identified springs; how far they are off is not known."
    else:
        promise = (
            "the servo assumes the identified values, and the robot differs from them as far as their "
            f"uncertainty allows. 95 of 100 such robots stay {_below(outcome.after_m)}, half of them "
            f"{_below(outcome.distribution.median_m)}."
        )
    assumed = outcome.assumed
    servo = (
        "takes the joints as rigid"
        if assumed is None
        else f"assumes K = {_three(assumed.K)} N·m/rad, D = {_three(assumed.D)} N·m·s/rad"
    )
    st.caption(
        "Path error is the largest distance of the tool from the wanted path, simulated.\n"
        "- **Before**: a robot with the identified springs, "
        f"K = {_three(outcome.robot.elasticity.K)} N·m/rad, whose servo {servo}.\n"
        f"- **After**: {promise}\n"
        f"- **Both**: {_conditions(settings)}"
    )
    if outcome.before.torque_limit_hit or outcome.after.torque_limit_hit:
        st.warning("A motor torque was cut off at its limit.")


def _conditions(settings: CutSettings) -> str:
    """Controller and friction, the same before and after."""
    encoder = f"{settings.encoder_bits}-bit encoders" if settings.encoder_bits else "ideal encoders"
    delay = f"{settings.delay_samples} sample{'' if settings.delay_samples == 1 else 's'}"
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


def show_figure_7(page: Page, settings: CutSettings, outcome: Outcome, nominal: str) -> None:
    """Three corner zones, nominal above, identified below, with the picture as a file."""
    pairs: list[tuple[float, tuple[TrackingRun, TrackingRun] | str]] = []
    for zone in ZONES_M:
        try:
            runs = cut_cached.pair(page.digest, page.method, settings, zone, outcome)
            pairs.append((zone, runs))
        except JointIdError as error:
            pairs.append((zone, str(error)))
    names = (nominal, "identified")
    st.html(_figure_7_html(pairs, names, colours(page.dark)))
    done = [(zone, runs) for zone, runs in pairs if not isinstance(runs, str)]
    if not done:
        return
    rows = [
        (name[:1].upper() + name[1:], [_shape(zone, runs, row, LIGHT) for zone, runs in done])
        for row, name in enumerate(names)
    ]
    st.download_button(
        "Save the figure (.svg)",
        data=lambda: shapes_svg(rows, title=f"Cuts of {page.study.name or 'a study'}").encode(),
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
            f'<div style="padding:0.5rem 0 0.25rem">{_key(colour)}'
            f"<b>{escape(name[:1].upper() + name[1:])}</b></div>"
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
            picture = _picture([shape], what, around)
            parts.append(
                f'<div style="{_COLUMN}">{picture}<br><b>{shape.caption[0]}</b><br>{label}</div>'
            )
        parts.append("</div>")
    return "".join(parts)


def _key(colour: str) -> str:
    """A short line of this colour before its meaning."""
    return (
        f'<span style="display:inline-block;width:1.4em;border-top:2.5px solid {colour};'
        'vertical-align:middle;margin-right:0.45em"></span>'
    )


def _picture(
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


def show_tolerance(page: Page, settings: CutSettings, outcome: Outcome) -> None:
    """The tolerance map, on demand: a few hundred cuts."""
    ranges = ["A factor of 3", "This identification's uncertainty"]
    chosen = st.segmented_control(
        "Range of K̂/K",
        ranges,
        default=ranges[0],
        required=True,
        key="cut_map_range",
        bind="query-params",
    )
    near = chosen == ranges[1]
    # The map does not depend on the nominal controller.
    cut = replace(settings, assumption="rigid", custom_K=(), custom_D=())
    key = (page.digest, page.method, cut, near)
    tolerance = cut_cached.kept_map(key)
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
        ratios = [_ratios(robot, joint, near) for joint in (0, 1)]
        tolerance = tolerance_map(
            robot.arm,
            outcome.toolpath,
            robot.elasticity,
            *ratios,
            servo=settings.servo,
            friction=settings.friction,
            progress=show,
        )
        cut_cached.keep_map(key, tolerance)
        place.empty()
    robot = outcome.robot
    plot(
        tolerance_heatmap(
            tolerance, robot.elasticity, robot.covariance, outcome.assumed, dark=page.dark
        ),
        "Largest path error over the ratios of assumed to true stiffness",
        key="cut_map_figure",
    )
    error = tolerance.max_contour_error_m
    st.caption(f"Errors on this map: {millimetres(error.min())} to {millimetres(error.max())}.")


def _ratios(robot: CutRobot, joint: int, near: bool) -> Floats:
    """K̂/K from 1/3 to 3, or as far as four standard errors."""
    error = float(np.sqrt(robot.covariance[joint, joint]) / robot.elasticity.K[joint])
    reach = float(np.clip(4 * error, 1e-5, 2.0))
    return np.geomspace(1 / (1 + reach), 1 + reach, _WIDE) if near else np.geomspace(1 / 3, 3, _WIDE)


def outcome_panel(page: Page, analysis: Analysis) -> None:
    """Path error before and after with a small picture of the cut, for the first screen."""
    try:
        outcome = cut_cached.overview(page.digest, page.method, analysis)
    except JointIdError as error:
        st.caption(f"What this is worth on a path is not known. {error}")
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
        picture, words = st.columns([1, 4], vertical_alignment="center")
        picture.html(_picture(shapes, what, around, "max-width:9rem"))
        with words:
            st.subheader(headline(outcome), anchor=False)
            st.html(
                f"{_key(ink.nominal)}{escape(servo)}, {escape(before)}<br>"
                f"{_key(ink.identified)}identified values, {escape(after)}"
            )
            arm = "the example arm" if outcome.robot.rule == "relative" else "an arm of these inertias"
            friction = " Both have the friction that was found." if outcome.robot.friction else ""
            promise = "The uncertainty of the identified values is too large to promise anything."
            if outcome.distribution is not None:
                promise = (
                    "95 of 100 robots within the uncertainty of the identified values stay "
                    f"{_below(outcome.after_m)}."
                )
            st.caption(
                f"A rectangle of 28 × 45 mm at 300 mm/s, cut by {arm}, simulated. {promise}{friction}"
            )
            st.page_link(CUT_PAGE, label="Watch the cut")
