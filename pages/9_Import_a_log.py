"""Any controller's logs: columns mapped, sine runs found, opened as a study."""

import streamlit as st

from jointid.ui.importing.panels import import_steps
from jointid.ui.importing.saved_import import kept_import
from jointid.ui.shared.page import start

start(
    "Import a log",
    "Logs of any controller become a study in five steps. A log needs the time, and position and torque "
    "or current of every motor; it may hold one run or many.",
)
progress = st.container(key="progress").empty()
with kept_import():
    import_steps(progress)
