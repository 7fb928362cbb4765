"""Panels of the fleet page on its robots: the summary, a table, and the drift of each."""

from collections.abc import Mapping, Sequence

import numpy as np
import streamlit as st

from jointid.estimation.estimators.parameters import PARAMETERS
from jointid.figures.fleet import drift_over_time
from jointid.fleet.spread import MIN_VALUES, OUTLIER_Z, Drift, Spread, robot_drift, seconds
from jointid.ui.fleet.panels import spread_in_words
from jointid.ui.shared.charts import plot, side_by_side, table
from jointid.ui.shared.messages import markdown_escape
from jointid.ui.shared.method_steps import IMPORT
from jointid.ui.shared.workspace import link_to
from jointid.wording import counted, enumerated, significant, unbroken, with_error

_CHANCE = 0.01
"""Probability that a fleet without any drift has a trend that is said to be a drift."""
Drifts = Mapping[str, list[Drift]]
"""Drift of K and D by robot, the clearest of K first; without robots it has one, of no name."""


def show_summary(spreads: Sequence[Spread], drifts: Drifts) -> None:
    """The softest or stiffest robot or else the stiffness of the fleet, outliers and drift."""
    if not (stiffness := spreads[0]).value.size:
        return
    counts = [(int(s.outliers.sum()), s.name) for s in spreads if np.isfinite(s.z).any()]
    outliers = [f"{counted(count, 'outlier')} of {name}" for count, name in counts if count]
    if counts and not outliers:
        outliers = ["no outliers"]
    far = _farthest_robots(stiffness) if len(drifts) > 1 else ""
    parts = [far or f"{stiffness.name}: {spread_in_words(stiffness)}"]  # also above its figure
    if outliers:
        parts.append(enumerated(outliers))
    name, (clearest, *_) = next(iter(drifts.items()))
    if name and _is_clear(clearest, drifts):
        parts.append(f"{clearest.name} of {markdown_escape(name)} {_trend(clearest)}")
    st.header(unbroken("; ".join(parts)), anchor=False)


def _farthest_robots(spread: Spread) -> str:
    """The robots whose typical studies are farthest from the fleet: two by name, others by number."""
    typical = {}
    for name in {row.robot for row in spread.rows if row.robot}:
        own = np.array([row.robot == name for row in spread.rows])
        if abs(float(np.median(spread.z[own]))) > OUTLIER_Z:
            typical[name] = float(np.median(spread.value[own])) / spread.median - 1
    if not typical:
        return ""
    names = sorted(typical, key=lambda each: -abs(typical[each]))
    each = [
        f"{markdown_escape(name)} is {significant(100 * abs(typical[name]), 2)} % "
        f"{'softer' if typical[name] < 0 else 'stiffer'} than the fleet"
        for name in names[:2]
    ]
    count = len(names) - 2
    more = [f"{counted(count, 'more robot')} {'differs' if count == 1 else 'differ'}"] * (count > 0)
    return enumerated([each[0], *(text.removesuffix(" than the fleet") for text in each[1:]), *more])


def show_robots(spreads: Sequence[Spread], drifts: Drifts) -> None:
    """One row per robot: its values, their drift, and its outliers."""
    if not any(drifts):
        return
    st.header("Robots", anchor=False)
    columns: dict[str, list[str]] = {"Robot": [_robot_name(name) for name in drifts]}
    for k, spread in enumerate(spreads):
        own = [np.array([row.robot == name for row in spread.rows]) for name in drifts]
        if not k:
            columns["Studies"] = [str(mask.sum()) for mask in own]
        unit = PARAMETERS[spread.name[0]].unit
        columns[f"{spread.name} ({unit})"] = [
            significant(float(np.median(spread.value[mask])), 4) if mask.any() else "" for mask in own
        ]
        columns[f"Drift of {spread.name} (%/year)"] = [
            _per_year(of_robot[k]) for of_robot in drifts.values()
        ]
        columns[f"Outliers of {spread.name}"] = [
            str((mask & spread.outliers).sum()) if np.isfinite(spread.z[mask]).any() else "–"
            for mask in own
        ]
    table(columns, height=330, phone=[*columns][:1] + [*columns][2:4])
    st.caption(
        "Median of each robot's studies. Drift: Theil–Sen slope over the dated studies, relative to the "
        "trend at the median date, ± one standard error. Scatter alone can look like drift, "
        "especially with many robots and few dates: a drift is reported only if chance alone would "
        f"produce one in fewer than {100 * _CHANCE:g} % of such fleets."
    )


def show_drift(spreads: Sequence[Spread], drifts: Drifts, *, dark: bool) -> None:
    """Values over the dates that studies state, one robot at a time with its trend."""
    dated = [row for row in spreads[0].rows if row.date]
    st.header("Drift over time", anchor=False)
    if not dated:
        st.info(
            "No study states its date. State it on import (step 5, Optional) or in study.toml: "
            'date = 2026-11-20. To follow one robot, state its name as well: robot = "cell 7, robot A".'
        )
        link_to(IMPORT)
        return
    robots = [name for name, of_robot in drifts.items() if of_robot[0].value.size]
    robot = st.selectbox(
        "Robot",
        robots,
        format_func=_robot_name,
        key="fleet_robot",
        bind="query-params",
        help="The robots with the most significant drift come first.",
    )
    for k, (spread, place) in enumerate(zip(spreads, side_by_side(len(spreads)), strict=True)):
        times = np.array([seconds(row.date) if row.date else np.nan for row in spread.rows])
        drift = drifts[robots[0] if robot is None else robot][k]
        with place:
            st.markdown(f"**{spread.name}** {_drift_in_words(drift, drifts)}")
            plot(
                drift_over_time(spread, times, drift, dark=dark),
                f"{spread.name} over time, all robots and the chosen one",
                key=f"fleet_drift_{spread.name[0]}",
            )


def drifts_of(spreads: Sequence[Spread], joint: int) -> Drifts:
    """Drift of K and D by robot, of a joint from 1; of robots without dates it has no values."""
    robots = {row.robot for row in spreads[0].rows}
    found = {
        robot: [robot_drift(spread.rows, spread.name[0], joint, robot) for spread in spreads]
        for robot in robots
    }

    def chance(robot: str) -> tuple[float, str]:
        p_value = found[robot][0].p_value
        return (p_value if np.isfinite(p_value) else 1.0, robot)

    return {robot: found[robot] for robot in sorted(robots, key=chance)}


def _drift_in_words(drift: Drift, drifts: Drifts) -> str:
    change, error = (100 * value for value in drift.per_year)
    if not np.isfinite(change):
        return f"needs at least {MIN_VALUES} dates for a trend"
    if not _is_clear(drift, drifts):
        return f"has no drift beyond its scatter, ± {significant(error, 2)} % per year"
    return f"{_trend(drift)}, relative to the trend at the median date"


def _trend(drift: Drift) -> str:
    change, error = (100 * value for value in drift.per_year)
    return f"{'rises' if change > 0 else 'falls'} by {with_error(abs(change), error)} % per year"


def _is_clear(drift: Drift, drifts: Drifts) -> bool:
    """Whether a trend is beyond what chance makes among all robots, joints, K and D."""
    joints = max((row.joints for row in drift.rows), default=0)
    tests = joints * sum(np.isfinite(each.p_value) for pair in drifts.values() for each in pair)
    return bool(drift.p_value * tests < _CHANCE)


def _per_year(drift: Drift) -> str:
    change, error = (100 * value for value in drift.per_year)
    return with_error(change, error) if np.isfinite(change) else ""


def _robot_name(name: str) -> str:
    return name or "no robot stated"
