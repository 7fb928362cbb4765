"""What is handed on: a report for people, files for other tools."""

import streamlit as st

from jointid import JointIdError
from jointid.answer import without
from jointid.exporting.tables import without_friction_and_delay
from jointid.files.study_files import pack_study
from jointid.ui.shared.messages import show_error, show_info
from jointid.ui.shared.page import open_page
from jointid.ui.shared.parse_numbers import numbers_in
from jointid.ui.study import downloads
from jointid.ui.study.downloads import download
from jointid.wording import file_stem

page = open_page("Report")
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
made = downloads.made_report(page.digest, page.method)
asked = made is None and downloads.asked_for_report()
if made is not None:
    downloads.show_report(place, made, stem)
else:
    downloads.offer_report(button, at_work=asked)

st.subheader("K, D and how they were obtained", anchor=False)
st.write("With covariance, friction, delay and inertias. SI units, seen from the motors.")
with st.container(horizontal=True):
    download("JSON", results.json, f"{stem}.json", "application/json")
    download("TOML", results.toml, f"{stem}.toml", "application/toml")
    download(
        "MATLAB (.mat)",
        results.mat,
        f"{stem}.mat",
        "application/octet-stream",
        hint="identification, model for ss(A, B, C, D), transfer for frd(H, omega), as measured and "
        "without friction and delay, and phasors.",
    )
with st.expander("What stands in it"):
    st.code(results.toml, language="toml", height=360)

st.subheader("Tables", anchor=False)
st.write(
    "CSV with a header line, every number with all its digits. H stands there as measured"
    + (
        f", and from torques {without(analysis.fit)} in columns of their own."
        if without_friction_and_delay(analysis)
        else "."
    )
)
with st.container(horizontal=True):
    download("Phasors (.csv)", results.phasors, f"{stem}_phasors.csv", "text/csv")
    if analysis.transfer_matrices:
        download("Transfer matrix H (.csv)", results.transfer, f"{stem}_H.csv", "text/csv")
if not analysis.transfer_matrices:
    show_info(f"There is no table of H. {analysis.transfer_problem}")

st.subheader("For robot simulators", anchor=False)
st.write(
    "Simulators see the joints from the arm. Through a gear ratio N, a stiffness K of the motor side "
    "becomes N²K; damping and rotor inertia likewise."
)
n = study.inertia.n
entered = st.text_input(
    "Gear ratios, motor turns per joint turn" + (", one per joint" if n > 1 else ""),
    key="gears",
    bind="query-params",
    placeholder=", ".join(["100", "80", "60", "50", "50", "50"][:n]),
    help="Negative where the motor turns the other way than its joint. One number holds for all joints.",
)
if entered.strip():
    try:
        ratio = numbers_in("Gear ratios", entered, count=n)
        for tab, (name, (ending, text)) in zip(
            st.tabs(["MuJoCo", "URDF", "SDF"]),
            downloads.snippets(results.identification, ratio).items(),
            strict=True,
        ):
            with tab:
                download(f"{name} ({ending})", text, f"{stem}{ending}", "application/xml")
                st.code(text, language="xml", height=360)
    except JointIdError as error:
        show_error(error)
else:
    st.caption(
        "Without them there is no snippet: a ratio that was guessed would be wrong by its square."
    )

st.subheader("The study", anchor=False)
st.write("study.toml and one table per record: readable without this software.")
with st.container(horizontal=True):
    download("Study, records as CSV (.zip)", lambda: pack_study(study), f"{stem}.zip", "application/zip")
    download(
        "Study, records as Parquet (.zip)",
        lambda: pack_study(study, record_format="parquet"),
        f"{stem}_parquet.zip",
        "application/zip",
        hint="Reads faster.",
    )

if asked:  # last, so that the rest of the page stands meanwhile
    downloads.make_report_at(place, page.digest, page.method, analysis, stem)
    button.empty()
