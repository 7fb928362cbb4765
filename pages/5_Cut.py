"""What knowing the springs is worth, in millimetres."""

import streamlit as st

from jointid import JointIdError
from jointid.cut.robot import cut_robot
from jointid.figures.cut import (
    corner_detail,
    path_error_histogram,
    path_error_over_time,
    torque_over_time,
)
from jointid.ui.cut import cached_cuts as cut_cached
from jointid.ui.cut.animation import show_animation
from jointid.ui.cut.panels import headline, remainder, show_meaning, show_rule, show_tolerance
from jointid.ui.cut.pictures import show_figure_7
from jointid.ui.cut.settings import ask, nominal_name
from jointid.ui.shared.charts import plot, side_by_side
from jointid.ui.shared.messages import show_error
from jointid.ui.shared.page import open_page

page = open_page("Cut")
st.title("Cut", anchor=False)
st.write(
    "Springs bend while the arm accelerates, and the tool leaves its path unless the servo moves the "
    "motors by as much in advance. It computes this deflection x from the K̂ and D̂ that it assumes: "
    "where these are wrong, the cut is wrong."
)
st.latex(
    r"""\begin{gathered}
    \mathbf u = \mathbf M_2(\mathbf q)\,\ddot{\mathbf q} + \mathbf c(\mathbf q, \dot{\mathbf q}) \\
    \hat D_j\,\dot x_j + \hat K_j\,x_j = u_j, \qquad \theta_j = q_j + x_j
    \end{gathered}"""
)
analysis = page.analysis()
try:
    robot = cut_robot(analysis)
    settings = ask(robot, page.digest)
    outcome = cut_cached.outcome(page.digest, page.method, settings, analysis)
    cut_cached.offset_costs(page.digest, page.method, settings.after, outcome.robot)  # for below
except JointIdError as error:
    show_error(error)
    st.stop()
name = nominal_name(settings.assumption)
st.subheader(headline(outcome), anchor=False)
show_rule(outcome.robot)
show_animation(outcome, name, dark=page.dark)
show_meaning(outcome, settings)

st.subheader("Three corner zones", anchor=False)
st.caption(
    "As Figure 7 of the paper: larger zones are cut faster through the corner, which bends the springs "
    "more. Grey is the wanted path; below each shape stands the largest path error."
)
show_figure_7(page, settings, outcome, name)

st.subheader("Over time", anchor=False)
one, two, three, four = side_by_side(4)
with one:
    st.markdown("**Error**")
    st.caption(
        "Path error: distance to the nearest point of the path. Tracking error: to where the tool "
        "should be at that time."
    )
    figure = page.drawn(f"error {settings}", lambda: path_error_over_time(outcome, dark=page.dark))
    plot(figure, "Path and tracking error over time", key="cut_error")
with two:
    st.markdown("**Torque**")
    st.caption(
        "Torque of each motor as the servo sets it. A servo that knows the springs adds what moves the "
        "motors by x."
    )
    figure = page.drawn(f"torque {settings}", lambda: torque_over_time(outcome, dark=page.dark))
    plot(figure, "Motor torques over time", key="cut_torque")
with three:
    corners = range(len(outcome.toolpath.corners()[0]))
    st.markdown("**A corner**")
    corner = st.segmented_control(
        "Corner",
        [str(k + 1) for k in corners],
        default="1",
        required=True,
        key="cut_corner",
        bind="query-params",
        label_visibility="collapsed",
    )
    chosen = int(corner or 1) - 1
    figure = page.drawn(
        f"corner {chosen} {settings}", lambda: corner_detail(outcome, chosen, dark=page.dark)
    )
    plot(figure, "Tool paths around a corner", key="cut_corner_figure")
with four:
    st.markdown("**What this identification promises**")
    if outcome.distribution is None:
        st.caption("Not known: see above.")
    elif not outcome.springs_matter:
        st.caption(remainder(outcome, settings.servo, settings.friction))
    else:
        demonstrated = outcome.robot.rule == "demonstration"
        source = "the errors of this demonstration" if demonstrated else "the fit's covariance"
        st.caption(
            f"{outcome.distribution.K.shape[0]} robots drawn from {source}, each cut by a servo with "
            "the identified values."
        )
        plot(
            path_error_histogram(outcome.distribution, dark=page.dark),
            "Distribution of the path error",
            key="cut_promise",
        )

st.subheader("How well K must be known", anchor=False)
st.write(
    "The largest path error when the servo assumes K̂ where the robot has the identified K, with this "
    "path and controller. On the map, lines join equal errors."
)
try:
    show_tolerance(page, settings, outcome)
except JointIdError as error:
    show_error(error)

with st.expander("What the paper states, and what is our assumption"):
    st.markdown(
        "**The paper states**: rectangles of 28 × 45 mm, cut at 300 mm/s in a horizontal plane with "
        "three corner zones; K = 43, 7.5 N·m/rad and D = 0.10, 0.015 N·m·s/rad seen from the motors; a "
        "largest error of several millimetres with non-optimal parameters at the largest zone.\n\n"
        "**Our assumption**, because the paper prints none of it: link lengths, masses, gear ratios and "
        "inertias of the arm (two links of 0.705 and 0.755 m, tool at 1.15 m from the base); the law by "
        "which the servo compensates the springs, its feedback (10 Hz), rate, delay and encoders; the "
        "sizes of the zones (1, 5 and 10 mm) and how a corner is rounded; an acceleration of at most "
        "15 m/s² and ramps of at least 50 ms; which parameters were non-optimal.\n\n"
        "**Both robots are simulated.** The identified values are the best that is known of the real "
        "robot, so the robot before has exactly these springs. After the identification the servo has "
        "them too, and what is left is the uncertainty of the fit: the blue path is that of a robot at "
        "the 95 % point of the path error. Errors of the inertias, flexible links and gear backlash are "
        "in neither."
    )
