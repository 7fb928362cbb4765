"""Any controller's logs: columns mapped, sine runs found, opened as a study."""

import streamlit as st

from jointid.ui.importing.files import drop_logs
from jointid.ui.importing.panels import choose_runs, map_columns, open_as_study
from jointid.ui.importing.pictures import choose_log
from jointid.ui.importing.saved_import import (
    clear_entries,
    keep_import,
    kept_import,
    show_storage_state,
)
from jointid.ui.importing.study import show_next_step
from jointid.ui.shared.page import start

start("Import a log")
st.title("Import a log", anchor=False)
st.write(
    "Logs of any controller become a study: say what the columns are, check the runs that were found, "
    "sines or any other motion, and give the inertias. One long log with many runs is as good as one "
    "log per run."
)
with kept_import():
    logs = drop_logs(clear_entries)
    keep_import()
    show_storage_state()
    if not logs:
        st.caption(
            "For instance a CSV with `time; position; torque`, a header line and one row per sample."
        )
        st.stop()

    next_step = st.container()
    log = choose_log(logs)
    mapping, not_confirmed = map_columns(log)
    runs = choose_runs(logs, log, mapping)
    with next_step:
        show_next_step(runs.used, bool(not_confirmed))
    open_as_study(log, mapping, runs, not_confirmed)
