"""The report: made on demand, offered as files, and shown on the page."""

from html import escape

import streamlit as st

from jointid import Analysis
from jointid.reporting.report import make_report, to_html, to_pdf
from jointid.ui.shared.background import run_in_background
from jointid.ui.shared.charts import download
from jointid.ui.shared.method_steps import REPORT_AT_ONCE
from jointid.ui.shared.page import Page
from jointid.ui.shared.results import Show, computed_on_click


def show_report(page: Page, analysis: Analysis, stem: str) -> None:
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
        preview(html, height=700)


def _write(analysis: Analysis, progress: Show) -> tuple[str, bytes]:
    """Return the report as HTML and as PDF."""
    report = run_in_background(
        make_report, analysis, progress=lambda done, what: progress(0.6 * done, what)
    )
    progress(0.6, "Preparing the HTML report")
    html = run_in_background(to_html, report)
    paper = "Preparing the PDF report"
    progress(0.65, paper)
    pdf = run_in_background(to_pdf, report, progress=lambda done: progress(0.65 + 0.35 * done, paper))
    return html, pdf


def preview(html: str, *, height: int) -> None:
    """Show a report on the page, in a frame that can neither run scripts nor reach the app."""
    style = f"border:0;width:100%;height:{height}px;display:block"
    frame = f'<iframe sandbox title="The report" style="{style}" srcdoc="{escape(html)}"></iframe>'
    st.iframe(f'<body style="margin:0">{frame}</body>', height=height)
