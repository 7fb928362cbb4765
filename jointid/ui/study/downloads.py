"""The report, and files for other tools: results, tables, simulator snippets, the study itself."""

from functools import partial
from html import escape

import numpy as np
import streamlit as st

from jointid import Analysis, JointIdError, Study, exporting
from jointid.analysis import Answer
from jointid.answer import without
from jointid.exporting.tables import without_friction_and_delay
from jointid.files.study_files import pack_study
from jointid.reporting.report import make_report, to_html, to_pdf
from jointid.ui.shared.charts import choose_segment, download
from jointid.ui.shared.entries import example_hint, numbers_in, numbers_out
from jointid.ui.shared.messages import show_error, show_info
from jointid.ui.shared.method_steps import REPORT_AT_ONCE
from jointid.ui.shared.page import Page
from jointid.ui.shared.results import Show, computed_on_click, run_in_background


def show_report(page: Page, analysis: Answer, stem: str) -> None:
    """Offer to make the report; once made, offer it as files and for a look."""
    made = computed_on_click(
        ("report", page.digest, page.method, page.unit),
        "Make the report",
        "make_report",
        lambda show: _write(analysis, show),
        kind="primary",
        at_once=st.session_state.get(REPORT_AT_ONCE) == st.session_state["chosen"],
    )
    if made is None:
        return
    html, pdf = made
    with st.container(horizontal=True):
        download("Report as PDF", pdf, f"{stem}_report.pdf", kind="primary")
        download("Report as HTML", html, f"{stem}_report.html")
    with st.expander("Preview"):
        style = "border:0;width:100%;height:700px;display:block"
        # A frame that can neither run scripts nor reach the app.
        frame = f'<iframe sandbox title="The report" style="{style}" srcdoc="{escape(html)}"></iframe>'
        st.iframe(f'<body style="margin:0">{frame}</body>', height=700)


def _write(analysis: Answer, progress: Show) -> tuple[str, bytes]:
    report = run_in_background(
        make_report, analysis, progress=lambda done, what: progress(0.6 * done, what)
    )
    progress(0.6, "Preparing the HTML report")
    html = run_in_background(to_html, report)
    paper = "Preparing the PDF report"
    progress(0.65, paper)
    pdf = run_in_background(to_pdf, report, progress=lambda done: progress(0.65 + 0.35 * done, paper))
    return html, pdf


_SNIPPETS = (
    ("MuJoCo", ".xml", exporting.mujoco_snippet),
    ("URDF", ".urdf", exporting.urdf_snippet),
    ("SDF", ".sdf", exporting.sdf_snippet),
)
_LAWS_HINT = (
    "Torque over deflection of every gear, motor side, up to the largest torque "
    "in the records: for a 1-D Lookup Table in Simulink or your own controller."
)
_MATLAB_HINT = (
    "Four structs: identification; phasors; model, for ss(A, B, C, D); transfer, for frd(H, omega), as "
    "measured and without friction and delay."
)


def show_identification_files(analysis: Answer, stem: str) -> None:
    """Offer K, D and their origin as CSV, JSON, TOML and MATLAB; of one answer where there are two."""
    if len(analysis.each) > 1:
        analysis = analysis.each[choose_segment("K from", list(analysis.each), "answer_of")]
    is_motor = isinstance(analysis, Analysis)
    what = "K, D and how they were" if is_motor else "K and how it was"
    st.header(f"{what} obtained", anchor=False)
    st.write(
        "With the state of the answer, covariance, friction, delay, and the inertias as given and as "
        "fitted. SI units, seen from the motors."
        if is_motor
        else "With the state of the answer, skew and why a K is undetermined. SI units, at the joint."
    )
    with st.container(horizontal=True):
        download("CSV", partial(exporting.answer_table, analysis), f"{stem}_K.csv")
        download("JSON", partial(exporting.to_json, analysis), f"{stem}.json")
        download("TOML", partial(exporting.to_toml, analysis), f"{stem}.toml")
        if isinstance(analysis, Analysis):
            mat = partial(exporting.to_mat, analysis)
            download("MATLAB (.mat)", mat, f"{stem}.mat", hint=_MATLAB_HINT)
    language = choose_segment("K and D as" if is_motor else "K as", list(exporting.LANGUAGES), "copy_as")
    st.code(exporting.code_listing(analysis, language), language=None, wrap_lines=language == "Text")
    for ending in (ending for ending, of in exporting.ENDINGS.items() if of == language):
        listing = partial(exporting.code_listing, analysis, language)
        download(f"{language} ({ending})", listing, f"{stem}{ending}")
    with st.expander("The whole file"):
        st.code(exporting.to_toml(analysis), language="toml", height=360)


def show_tables(analysis: Analysis, stem: str) -> None:
    """Offer phasors, gear laws and transfer matrix as CSV."""
    st.header("Tables", anchor=False)
    separate = f" and, in separate columns, {without(analysis.fit)}"
    st.write(
        "CSV with a header line and full precision. H is given as measured"
        + (separate if without_friction_and_delay(analysis) else "")
        + "."
    )
    with st.container(horizontal=True):
        if analysis.study.sine_records:
            download("Phasors (.csv)", partial(exporting.phasor_table, analysis), f"{stem}_phasors.csv")
        laws = f"{stem}_gears"
        download(
            "Gear laws (.csv)", partial(exporting.gear_table, analysis), f"{laws}.csv", hint=_LAWS_HINT
        )
        modelica = "The same for CombiTable1Ds of Modelica: tables gear1, gear2, …"
        download(
            "Gear laws for Modelica (.txt)",
            partial(exporting.modelica_table, analysis),
            f"{laws}.txt",
            hint=modelica,
        )
        if analysis.transfer_matrices:
            H = partial(exporting.transfer_matrix_table, analysis)
            download("Transfer matrix H (.csv)", H, f"{stem}_H.csv")
    if not analysis.transfer_matrices:
        show_info(f"There is no table of H. {analysis.transfer_problem}")


def show_simulator_files(analysis: Analysis, stem: str) -> None:
    """Offer the joints as snippets for simulators; ask for gear ratios that the study does not state."""
    n, ratio = analysis.fit.n, analysis.study.gear_ratios
    st.header("For robot simulators", anchor=False)
    st.write(
        "Simulators use joint-side values. With a gear ratio N, a stiffness K at the motor becomes "
        "N²K at the joint; damping and rotor inertia likewise. These formats hold linear springs: a "
        "nonlinear gear gets its secant stiffness at the largest torque in the records, and the file "
        "states this torque."
    )
    if ratio is None:
        entered = st.text_input(
            "Gear ratios, motor turns per joint turn" + (", one per joint" if n > 1 else ""),
            key="gears",
            bind="query-params",
            placeholder=example_hint(", ".join(["100", "80", "60", "50", "50", "50"][:n])),
            help="Negative if motor and joint turn in opposite directions. "
            "One number applies to all joints.",
        )
    else:
        entered = numbers_out(ratio)
        st.caption(f"Gear ratios of the study: {entered}.")
    if entered.strip():
        try:
            if ratio is None:
                ratio = np.array(numbers_in("Gear ratios", entered, count=n))
            texts = [(name, ending, write(analysis, ratio)) for name, ending, write in _SNIPPETS]
            for tab, (name, ending, text) in zip(st.tabs([x[0] for x in texts]), texts, strict=True):
                with tab:
                    download(f"{name} ({ending})", text, f"{stem}{ending}")
                    st.code(text, language="xml", height=360)
        except JointIdError as error:
            show_error(error)
    else:
        st.caption("These files need the gear ratios; K at the joint depends on their squares.")


def show_study_files(study: Study, stem: str) -> None:
    """Offer the study itself."""
    st.header("The study", anchor=False)
    st.write("study.toml and one table per record: readable without this software.")
    with st.container(horizontal=True):
        download("Study, records as CSV (.zip)", partial(pack_study, study), f"{stem}.zip")
        packed = partial(pack_study, study, record_format="parquet")
        download("Study, records as Parquet (.zip)", packed, f"{stem}_parquet.zip", hint="Reads faster.")
