"""The report, and files for other tools."""

import streamlit as st

from jointid import JointIdError
from jointid.ui.shared.messages import show_error
from jointid.ui.shared.page import open_page
from jointid.ui.study import downloads, report_panel
from jointid.wording import file_stem

page = open_page("Report and export")
st.title("Report and export", anchor=False)
st.write(
    "Everything that was found, to hand to a colleague or to take into another tool. Each file says how "
    "its numbers were obtained: version, settings, and the digest, a fingerprint by which the study is "
    "known again. "
    "The same study gives the same files, to the last byte."
)
analysis = page.analysis()
stem, study = file_stem(page.study.name), page.study
try:
    results = downloads.results(page.digest, page.method, analysis)
except JointIdError as error:
    show_error(error)
    st.stop()

st.subheader("The report", anchor=False)
st.write("What was measured, the answer with ±, the verdict, the figures and the settings.")
button, place = st.empty(), st.empty()
shown_as = page.digest if analysis.unit.is_default else f"{page.digest} {page.unit}"
made = report_panel.made_report(shown_as, page.method)
asked = made is None and report_panel.asked_for_report()
if made is not None:
    report_panel.show_report(place, made, stem)
else:
    report_panel.offer_report(button, at_work=asked)

downloads.show_identification_files(results, stem)
downloads.show_tables(results, analysis, stem)
downloads.show_simulator_files(results, study, stem)
downloads.show_study_files(study, stem)

if asked:  # last: the rest of the page is drawn first
    report_panel.make_report_at(place, shown_as, page.method, analysis, stem)
    button.empty()
