"""The report, and files for other tools."""

from functools import partial

import streamlit as st

from jointid.analysis import NOT_USABLE, Analysis
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
stem = file_stem(page.study.name)
study_files = partial(downloads.show_study_files, page.study, stem)
analysis = page.answer(otherwise=study_files)
if analysis.state == NOT_USABLE:
    show_error(f"{analysis.headline} The files with K and D state this first.")

st.header("The report", anchor=False)
st.write("Records, answer with error bars, verdict, figures and settings.")
show_report(page, analysis, stem)

downloads.show_identification_files(analysis, stem)
if isinstance(motors := analysis.each.get("Motors"), Analysis):
    downloads.show_tables(motors, stem)
    downloads.show_simulator_files(motors, stem)
study_files()
