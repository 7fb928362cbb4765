"""The pieces of the fleet's page."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import streamlit as st

from jointid import JointIdError
from jointid.figures.fleet import distribution, drift_over_time
from jointid.fleet.row import Row
from jointid.fleet.spread import LEAST, OUTSTANDING, Drift, Spread, fleet_spread, robot_drift, seconds
from jointid.rounding import significant, with_error
from jointid.study_files import load_study
from jointid.ui.charts import plot, side_by_side, table
from jointid.ui.fleet_files import OpenFleet
from jointid.ui.steps import OVERVIEW
from jointid.ui.workspace import keep, recent
from jointid.wording import counted

_UNITS = {"K": "N·m/rad", "D": "N·m·s/rad"}
_QUANTITIES = {"K": "Stiffness", "D": "Damping"}
_CLEAR = 3.0
_VERDICTS = ("good", "warning", "problem")
_SIGNS = {"good": "✓ good", "warning": "△ warning", "problem": "✕ problem", "": "— failed"}


def show_headline(rows: Sequence[Row]) -> None:
    """How many studies, of how many robots, and how they came out."""
    good = [row for row in rows if row.is_good]
    robots = {row.robot for row in good if row.robot}
    parts = [counted(len(rows), "study")]
    if robots:
        parts.append(counted(len(robots), "robot"))
    parts += [
        f"{count} {level}" for level in _VERDICTS if (count := sum(r.verdict == level for r in good))
    ]
    if failed := len(rows) - len(good):
        parts.append(f"{failed} failed")
    st.markdown(" &nbsp;·&nbsp; ".join(parts))


def choose(rows: Sequence[Row]) -> tuple[int, bool]:
    """Ask which joint, and what studies are compared with; returns the joint from 1."""
    joints = max((row.joints for row in rows), default=0)
    left, right = st.columns(2)
    with left:
        joint = st.segmented_control(
            "Joint",
            range(1, joints + 1),
            default=1,
            required=True,
            format_func=lambda j: f"Joint {j}",
            key="fleet_joint",
            bind="query-params",
        )
    choices = ["the fleet", "the same robot"]
    with right:
        against = st.segmented_control(
            "Every study is compared with",
            choices,
            default=choices[0],
            required=True,
            key="fleet_against",
            bind="query-params",
            help="Where robots differ by design, compare each with its own studies.",
        )
    return min(int(joint or 1), joints), against == choices[1]


def show_spread(spreads: Sequence[Spread], *, dark: bool) -> None:
    """Stiffness and damping side by side, with their median and spread in words."""
    for spread, place in zip(spreads, side_by_side(len(spreads)), strict=True):
        with place:
            quantity, unit = spread.name[0], _UNITS[spread.name[0]]
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
    return f"median {significant(spread.median, 3)}; {LEAST} studies or more tell a spread, in"


def show_drift(spreads: Sequence[Spread], joint: int, *, dark: bool) -> None:
    """Values over the dates that studies state, one robot at a time with its trend."""
    dated = [row for row in spreads[0].rows if row.date]
    st.subheader("Drift over time", anchor=False)
    if not dated:
        st.info(
            "No study says when it was measured. Add to its study.toml: date = 2026-11-20, and "
            'robot = "cell 7, robot A" to follow one robot.'
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
            f"chance; below {_CLEAR:g} standard errors nothing is said to drift."
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
        return f": {LEAST} dates or more tell a trend"
    if abs(change) < _CLEAR * error:
        return f"has no drift beyond its scatter, ± {significant(error, 2)} % a year"
    return f"{'rises' if change > 0 else 'falls'} by {with_error(abs(change), error)} % a year"


def _per_year(drift: Drift) -> str:
    change, error = (100 * value for value in drift.per_year)
    return with_error(change, error) if np.isfinite(change) else ""


def _robot_name(name: str) -> str:
    return name or "no robot stated"


def show_outstanding(spreads: Sequence[Spread], *, within_robot: bool) -> None:
    """Which values stand out, and by which rule."""
    st.subheader("What stands out", anchor=False)
    whose = "its robot's studies" if within_robot else "the fleet"
    st.caption(
        f"A value stands out when it lies more than {OUTSTANDING:g} times as far from the median of "
        f"{whose} as is expected: z = distance / √(s² + e²), with s the robust spread there (1.48 times "
        "the median distance from the median) and e the value's own standard error. A study that knows "
        f"little does not stand out; fewer than {LEAST} studies tell no spread."
    )
    found = []
    for spread in spreads:
        for k in np.flatnonzero(spread.outstanding):
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
                        "z": f"{spread.z[k]:+.1f}".replace("-", "−"),
                        "Verdict": _SIGNS[row.verdict],
                    },
                )
            )
    if not found:
        st.success("Nothing stands out for this joint.")
        return
    found.sort(key=lambda pair: pair[0])
    columns = {name: [entry[name] for _, entry in found] for name in found[0][1]}
    table(columns, height=300)


def show_failed(rows: Sequence[Row]) -> None:
    """Studies without an answer, and why."""
    failed = [row for row in rows if not row.is_good]
    if not failed:
        return
    st.subheader(f"Failed: {counted(len(failed), 'study')}", anchor=False)
    table({"Study": [label(row) for row in failed], "Why": [row.error for row in failed]}, height=300)


def show_studies(fleet: OpenFleet, rows: Sequence[Row]) -> None:
    """Every study in a table; a chosen one can be opened."""
    st.subheader("Every study", anchor=False)
    if not fleet.columns:
        fleet.columns = _columns(rows)
    st.dataframe(
        fleet.columns,
        hide_index=True,
        height=min(36 + 35 * len(rows), 400),
        key="fleet_table",
        on_select=_take_selection,
        selection_mode="single-row",
    )
    st.selectbox(
        "Study to look at",
        range(len(rows)),
        index=None,
        format_func=lambda k: f"{k + 1}: {label(rows[k])}",
        key="fleet_study",
        placeholder="Choose here, or tick a row of the table",
    )
    chosen = st.session_state.get("fleet_study")
    if chosen is not None and chosen < len(rows):
        _show_study(fleet, rows[chosen])


def _columns(rows: Sequence[Row]) -> dict[str, list[str]]:
    columns = {
        "Study": [label(row) for row in rows],
        "Robot": [row.robot for row in rows],
        "Date": [row.date for row in rows],
        "Verdict": [_SIGNS[row.verdict] for row in rows],
    }
    for j in range(max(row.joints for row in rows)):
        for quantity in "KD":
            columns[f"{quantity}{j + 1}"] = [_value(row, quantity, j) for row in rows]
    return columns


def _take_selection() -> None:
    selected = st.session_state["fleet_table"]["selection"]["rows"]
    if selected:
        st.session_state["fleet_study"] = selected[0]


def _show_study(fleet: OpenFleet, row: Row) -> None:
    with st.container(border=True):
        st.markdown(f"**{_literal(row.name or label(row))}** &nbsp;·&nbsp; {_SIGNS[row.verdict]}")
        if not row.is_good:
            st.error(row.error)
        for finding in row.findings[:3]:
            st.caption(_literal(finding))
        entry = next((e for e in recent().values() if row.digest and e.digest == row.digest), None)
        if entry is not None or (row.is_good and row.content in fleet.studies):
            if not st.button("Open this study", key="fleet_open_study"):
                return
            try:
                if entry is not None:
                    st.session_state["chosen"] = entry.id
                else:
                    keep(load_study(fleet.studies[row.content]), label(row))
                st.switch_page(OVERVIEW.path)
            except JointIdError as error:
                st.error(str(error))
        elif row.is_good:
            st.caption(
                "This study is not in this workspace, and a table's paths are not opened for whoever "
                "brings them. Open its .zip at the side, or drop it above: then it opens from here."
            )


def label(row: Row) -> str:
    """A short name: the last two parts of the path."""
    return "/".join(row.study.replace("\\", "/").rstrip("/").split("/")[-2:])


def _value(row: Row, quantity: str, j: int) -> str:
    if row.joints <= j:
        return ""
    return with_error(getattr(row, quantity)[j], getattr(row, f"{quantity}_error")[j])


def _literal(text: str) -> str:
    """Text as it stands, not as Markdown."""
    return "".join(f"\\{c}" if c in "\\`*_{}[]()#+-.!|~$:<>" else c for c in text)


def spreads_of(rows: Sequence[Row], joint: int, *, within_robot: bool) -> list[Spread]:
    """Spread of K and D of one joint."""
    return [fleet_spread(rows, quantity, joint, within_robot=within_robot) for quantity in "KD"]
