"""Many studies side by side."""

import streamlit as st

from jointid.fleet.spread import fleet_spread
from jointid.fleet.table import to_parquet
from jointid.ui.fleet import panels, robots
from jointid.ui.fleet.files import open_fleet, show_samples_button
from jointid.ui.shared.charts import download, is_dark
from jointid.ui.shared.page import start

start(
    "Fleet",
    "Many robots, or one robot over the years: spread and drift of stiffness and damping, and outliers. "
    "Each study is analysed separately, as on the page Study.",
)
fleet = open_fleet()
rows = list(fleet.rows.values())
if not rows:
    st.caption("To analyse thousands of studies, use the command line, on this computer or a cluster:")
    st.code("jointid batch cells/ --output results.parquet", language="bash", wrap_lines=True)
    show_samples_button()
    st.stop()

panels.show_headline(rows)
if any(row.is_good for row in rows):
    joint, within_robot = panels.choose(rows)
    both = (fleet_spread(rows, quantity, joint, within_robot=within_robot) for quantity in "KD")
    if spreads := [spread for spread in both if spread.value.size]:
        drifts = robots.drifts_of(spreads, joint)
        robots.show_summary(spreads, drifts)
        panels.show_spread(spreads, dark=is_dark())
        robots.show_robots(spreads, drifts)
        panels.show_outstanding(spreads, within_robot=within_robot)
        robots.show_drift(spreads, drifts, dark=is_dark())
    else:
        st.info(f"No study determines K and D of joint {joint}.")
panels.show_failed(rows)
panels.show_studies(fleet, rows)
download(
    "Save these results (.parquet)",
    lambda: to_parquet(rows),
    "results.parquet",
    hint="One row per study: state, K1, K1_error (all causes), D1 and so on, verdict, errors; misfit is "
    "the square of residual over noise, 1 is ideal; equal data have an equal digest.",
)
