"""Panels of the fleet page: headline, spread, outliers."""

from collections.abc import Sequence

import numpy as np
import streamlit as st

from jointid.analysis import STATES
from jointid.answer import UNITS
from jointid.figures.fleet import distribution
from jointid.fleet.row import Row
from jointid.fleet.spread import MIN_VALUES, OUTLIER_Z, Spread, few_values, fleet_spread
from jointid.ui.fleet.studies import SIGNS, label
from jointid.ui.shared.charts import choose_segment, plot, side_by_side, table
from jointid.wording import counted, minus, significant, with_error

_QUANTITIES = {"K": "Stiffness", "D": "Damping"}


def show_headline(rows: Sequence[Row]) -> None:
    """Number of studies and robots, and the states of the answers."""
    good = [row for row in rows if row.is_good]
    robots = {row.robot for row in good if row.robot}
    parts = [counted(len(rows), "study")]
    if robots:
        parts.append(counted(len(robots), "robot"))
    parts += [
        f"{count} {state}" for state in STATES if (count := sum(row.state == state for row in good))
    ]
    if failed := len(rows) - len(good):
        parts.append(f"{failed} failed")
    st.markdown(" &nbsp;·&nbsp; ".join(parts))


def choose(rows: Sequence[Row]) -> tuple[int, bool]:
    """Ask for the joint, from 1, and whether studies are compared within their robot."""
    joints = max((row.joints for row in rows), default=0)
    left, right = st.columns(2)
    with left:
        joint = choose_segment(
            "Joint", range(1, joints + 1), "fleet_joint", format_func=lambda j: f"Joint {j}"
        )
    choices = ["the fleet", "the same robot"]
    with right:
        against = choose_segment(
            "Every study is compared with",
            choices,
            "fleet_against",
            hint="Where robots differ by design, compare each with its own studies.",
        )
    return min(joint, joints), against == choices[1]


def show_spread(spreads: Sequence[Spread], *, dark: bool) -> None:
    """Stiffness and damping side by side, with their median and spread in words."""
    for spread, place in zip(spreads, side_by_side(len(spreads)), strict=True):
        with place:
            quantity = spread.name[0]
            st.markdown(f"**{_QUANTITIES[quantity]} {spread.name}**: {_in_words(spread)}")
            plot(
                distribution(spread, dark=dark),
                f"How many studies have which {spread.name}",
                key=f"fleet_{quantity}",
            )
    st.caption(
        "Solid line: median. Dotted lines: the robust spread to either side, 1.48 times the median "
        "distance from the median. Crosses: outliers; arrows: beyond the figure."
    )


def _in_words(spread: Spread) -> str:
    unit = UNITS[spread.name[0]]
    if np.isfinite(spread.spread):
        share = 100 * spread.spread / abs(spread.median) if spread.median else float("nan")
        text = with_error(spread.median, spread.spread)
        return f"median ± robust spread {text} {unit} ({significant(share, 2)} %)"
    if spread.value.size < 2:
        return f"{significant(spread.median, 3)} {unit}; a spread needs at least 2 studies"
    *limits, ratio = (significant(x, 2) for x in few_values(spread.value, spread.error))
    return (
        f"mean {significant(float(spread.value.mean()), 4)}, standard deviation {limits[0]} {unit} from "
        f"{spread.value.size} studies (95 %: {limits[1]} to {limits[2]}), {ratio} × the standard errors"
    )


def show_outstanding(spreads: Sequence[Spread], *, within_robot: bool) -> None:
    """Outliers, and their criterion."""
    st.header("Outliers", anchor=False)
    whose = "its robot's studies" if within_robot else "the fleet"
    st.caption(
        f"A value is an outlier beyond {OUTLIER_Z:g} times its expected distance from the median of "
        f"{whose}: z = distance / √(s² + e²), with the robust spread s of these studies (1.48 times the "
        f"median distance from the median) and the value's own standard error e. At least "
        f"{MIN_VALUES} studies are needed."
    )
    if not any(len(spread.rows) >= MIN_VALUES for spread in spreads):
        st.info(f"Outliers need at least {MIN_VALUES} studies.")
        return
    found = [(spread, k) for spread in spreads for k in np.flatnonzero(spread.outliers)]
    if not found:
        st.success("No outliers of this joint.")
        return
    found.sort(key=lambda pair: -abs(float(pair[0].z[pair[1]])))
    rows = [spread.rows[k] for spread, k in found]
    columns = {
        "Study": [label(row) for row in rows],
        "Robot": [row.robot for row in rows],
        "Date": [row.date for row in rows],
        "Value": [f"{s.name} = {with_error(float(s.value[k]), float(s.error[k]))}" for s, k in found],
        "Median": [significant(float(s.centre[k]), 4) for s, k in found],
        "z": [minus(f"{s.z[k]:+.1f}") for s, k in found],
        "State": [SIGNS[row.state] for row in rows],
    }
    table(columns, height=300)


def spreads_of(rows: Sequence[Row], joint: int, *, within_robot: bool) -> list[Spread]:
    """Spread of K and D of one joint."""
    return [fleet_spread(rows, quantity, joint, within_robot=within_robot) for quantity in "KD"]
