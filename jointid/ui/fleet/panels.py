"""Panels of the fleet page: headline, spread, outliers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import streamlit as st

from jointid.figures.fleet import distribution
from jointid.fleet.row import Row
from jointid.fleet.spread import MIN_VALUES, OUTLIER_Z, Spread, fleet_spread
from jointid.rounding import minus, significant, with_error
from jointid.study import STATES
from jointid.ui.fleet.studies import SIGNS, label
from jointid.ui.shared.charts import UNITS, choose_segment, plot, side_by_side, table
from jointid.wording import counted

_QUANTITIES = {"K": "Stiffness", "D": "Damping"}


def show_headline(rows: Sequence[Row]) -> None:
    """How many studies, of how many robots, and how they came out."""
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
            quantity, unit = spread.name[0], UNITS[spread.name[0]]
            st.markdown(f"**{_QUANTITIES[quantity]} {spread.name}**: {_in_words(spread)} {unit}")
            plot(
                distribution(spread, dark=dark),
                f"How many studies have which {spread.name}",
                key=f"fleet_{quantity}",
            )
    st.caption(
        "Solid line: median. Dotted lines: the robust spread to either side, 1.48 times the median "
        "distance from the median. Crosses stand out; arrows lie beyond the figure."
    )


def _in_words(spread: Spread) -> str:
    if np.isfinite(spread.spread):
        share = 100 * spread.spread / abs(spread.median) if spread.median else float("nan")
        text = with_error(spread.median, spread.spread)
        return f"median {text} ({significant(share, 2)} %)"
    return f"median {significant(spread.median, 3)}; {MIN_VALUES} studies or more tell a spread, in"


def show_outstanding(spreads: Sequence[Spread], *, within_robot: bool) -> None:
    """Outliers, and their criterion."""
    st.subheader("What stands out", anchor=False)
    whose = "its robot's studies" if within_robot else "the fleet"
    st.caption(
        f"A value stands out when it lies more than {OUTLIER_Z:g} times as far from the median of "
        f"{whose} as is expected: z = distance / √(s² + e²), with s the robust spread there (1.48 times "
        "the median distance from the median) and e the value's own standard error. A study that knows "
        f"little does not stand out; fewer than {MIN_VALUES} studies tell no spread."
    )
    found = []
    for spread in spreads:
        for k in np.flatnonzero(spread.outliers):
            row = spread.rows[k]
            value = with_error(float(spread.value[k]), float(spread.error[k]))
            found.append(
                (
                    -abs(float(spread.z[k])),
                    {
                        "Study": label(row),
                        "Robot": row.robot,
                        "Date": row.date,
                        "Value": f"{spread.name} = {value}",
                        "Median": significant(float(spread.centre[k]), 4),
                        "z": minus(f"{spread.z[k]:+.1f}"),
                        "State": SIGNS[row.state],
                    },
                )
            )
    if not any(len(spread.rows) >= MIN_VALUES for spread in spreads):
        st.info(f"With fewer than {MIN_VALUES} studies nothing can be said to stand out.")
        return
    if not found:
        st.success("Nothing stands out for this joint.")
        return
    found.sort(key=lambda pair: pair[0])
    columns = {name: [entry[name] for _, entry in found] for name in found[0][1]}
    table(columns, height=300)


def spreads_of(rows: Sequence[Row], joint: int, *, within_robot: bool) -> list[Spread]:
    """Spread of K and D of one joint."""
    return [fleet_spread(rows, quantity, joint, within_robot=within_robot) for quantity in "KD"]
