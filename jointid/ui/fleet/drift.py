"""Drift of K and D of each robot over the years, on the fleet's page."""

from collections.abc import Sequence

import numpy as np
import streamlit as st

from jointid.figures.fleet import drift_over_time
from jointid.fleet.spread import MIN_VALUES, Drift, Spread, robot_drift, seconds
from jointid.ui.shared.charts import plot, side_by_side, table
from jointid.wording import significant, with_error

_CLEAR = 3.0
"""Standard errors beyond which a trend is said to be a drift."""


def show_drift(spreads: Sequence[Spread], joint: int, *, dark: bool) -> None:
    """Values over the dates that studies state, one robot at a time with its trend."""
    dated = [row for row in spreads[0].rows if row.date]
    st.header("Drift over time", anchor=False)
    if not dated:
        st.info(
            "No study states its date. Give it on the page Import a log, under "
            "Optional, or in study.toml: date = 2026-11-20; and to follow one robot, its name: robot = "
            '"cell 7, robot A".'
        )
        return
    drifts = _drifts(spreads, joint)
    robots = list(drifts)
    robot = st.selectbox(
        "Robot",
        robots,
        format_func=_robot_name,
        key="fleet_robot",
        bind="query-params",
        help="Those whose stiffness drifts most clearly come first.",
    )
    for k, (spread, place) in enumerate(zip(spreads, side_by_side(len(spreads)), strict=True)):
        times = np.array([seconds(row.date) if row.date else np.nan for row in spread.rows])
        drift = drifts[robots[0] if robot is None else robot][k]
        with place:
            st.markdown(f"**{spread.name}** {_drift_in_words(drift)}")
            plot(
                drift_over_time(spread, times, drift, dark=dark),
                f"{spread.name} over time, all robots and the chosen one",
                key=f"fleet_drift_{spread.name[0]}",
            )
    with st.expander("The drift of every robot"):
        columns = {
            "Robot": [_robot_name(name) for name in robots],
            "Studies with a date": [str(drifts[name][0].value.size) for name in robots],
        }
        for k, spread in enumerate(spreads):
            columns[f"{spread.name} a year (%)"] = [_per_year(drifts[name][k]) for name in robots]
        table(columns, height=300)
        st.caption(
            "Median of the slopes between all pairs of studies (Theil and Sen) over the level, ± one "
            "standard error from the scatter around the line. Of many robots, some seem to drift by "
            f"chance: a drift below {_CLEAR:g} standard errors does not count."
        )


def _drifts(spreads: Sequence[Spread], joint: int) -> dict[str, list[Drift]]:
    """Drift of K and D by robot, the clearest of K first."""
    robots = {row.robot for row in spreads[0].rows if row.date}
    found = {
        robot: [robot_drift(spread.rows, spread.name[0], joint, robot) for spread in spreads]
        for robot in robots
    }

    def clearness(robot: str) -> tuple[float, str]:
        change, error = found[robot][0].per_year
        return (-abs(change) / error if np.isfinite(change) and error > 0 else 0.0, robot)

    return {robot: found[robot] for robot in sorted(robots, key=clearness)}


def _drift_in_words(drift: Drift) -> str:
    change, error = (100 * value for value in drift.per_year)
    if not np.isfinite(change):
        return f": at least {MIN_VALUES} dates are needed for a trend"
    if abs(change) < _CLEAR * error:
        return f"has no drift beyond its scatter, ± {significant(error, 2)} % a year"
    return f"{'rises' if change > 0 else 'falls'} by {with_error(abs(change), error)} % a year"


def _per_year(drift: Drift) -> str:
    change, error = (100 * value for value in drift.per_year)
    return with_error(change, error) if np.isfinite(change) else ""


def _robot_name(name: str) -> str:
    return name or "no robot stated"
