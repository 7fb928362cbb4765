"""One sine run from any controller's log."""

import streamlit as st

from jointid import JointIdError
from jointid.figures import raw_columns
from jointid.log_files import MAX_LOG_BYTES, read_log
from jointid.ui.charts import is_dark, plot, table
from jointid.ui.log_import import (
    ask_rest,
    choose_columns,
    imported_study,
    proposed_frequency_hz,
    signals,
)
from jointid.ui.page import start
from jointid.ui.steps import OVERVIEW
from jointid.ui.workspace import keep

start("Import a log")
st.title("Import a log", anchor=False)
st.write(
    "A CSV file in which every joint follows a sine of one frequency becomes a study of one record. "
    "Separator, decimal mark and comment lines are found by themselves; say which column is what. "
    "For many records, a study folder is the better way."
)
file = st.file_uploader(
    "Log (.csv, .txt)",
    type=["csv", "txt", "log", "dat", "tsv"],
    max_upload_size=MAX_LOG_BYTES >> 20,
    key="log_file",
)
if file is None:
    st.caption("For instance: `time; position; torque`, a header line and one row per sample.")
    st.stop()
try:
    columns = read_log(file.name, file.getvalue())
except JointIdError as error:
    st.error(str(error))
    st.stop()

mapped = choose_columns(columns)
shown = {name: columns[name] for name in (mapped.time, *mapped.positions, *mapped.torques)}
plot(raw_columns(shown, dark=is_dark()), "The chosen columns over time")
try:
    time, theta, tau = signals(columns, mapped)
    experiment = ask_rest(file.name, len(mapped.positions), proposed_frequency_hz(time, theta))
    if experiment is not None:
        keep(imported_study(file.name, experiment, time, theta, tau), file.name)
        st.switch_page(OVERVIEW.path)
except JointIdError as error:
    st.error(str(error))
with st.expander("The first rows of the file"):
    table({name: values[:50] for name, values in columns.items()}, height=300)
