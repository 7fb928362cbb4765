"""The report, and files for other tools."""

import streamlit as st

from jointid import JointIdError
from jointid.analysis import NOT_USABLE
from jointid.exporting import identification
from jointid.ui.shared.messages import show_error
from jointid.ui.shared.page import open_page
from jointid.ui.study import downloads
from jointid.ui.study.downloads import show_report
from jointid.wording import file_stem

page = open_page(
    "Report and export",
    "All results for a colleague or another tool. The files with K and D state version, settings and "
    "the digest of the study. The same study gives the same files, byte for byte.",
)
analysis = page.analysis()
if analysis.state == NOT_USABLE:
    show_error(f"{analysis.headline} Every file states this first.")
stem, study = file_stem(page.study.name), page.study
try:
    found = page.computed("results", "Collecting the results", identification, analysis)
except JointIdError as error:
    show_error(error)
    st.stop()

st.header("The report", anchor=False)
st.write("Records, answer with error bars, verdict, figures and settings.")
show_report(page, analysis, stem)

downloads.show_identification_files(found, analysis, stem)
downloads.show_tables(found, analysis, stem)
downloads.show_simulator_files(found, study, stem)
downloads.show_study_files(study, stem)
