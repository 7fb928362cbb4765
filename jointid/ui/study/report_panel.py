"""The report: made on demand, offered as files, and shown on the page."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from html import escape

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from jointid import Analysis, JointIdError
from jointid.reporting.report import make_report, to_html, to_pdf
from jointid.ui.shared.background import run_in_background
from jointid.ui.shared.charts import download
from jointid.ui.shared.messages import show_error
from jointid.ui.shared.results import result_cache
from jointid.ui.study.uncertainty_panels import steps_at


@dataclass(frozen=True)
class MadeReport:
    """A report as HTML and as PDF."""

    html: str
    pdf: bytes


def made_report(digest: str, method: str) -> MadeReport | None:
    """Return a report that was made before."""
    made: MadeReport | None = result_cache().get(("report", digest, method))
    return made


def write_report(
    digest: str, method: str, analysis: Analysis, progress: Callable[[float, str], object]
) -> MadeReport:
    """Make the report and keep it."""
    report = run_in_background(
        make_report, analysis, progress=lambda done, what: progress(0.6 * done, what)
    )
    progress(0.6, "Setting the pages for the screen")
    html = run_in_background(to_html, report)
    paper = "Setting the pages for paper"
    progress(0.65, paper)
    pdf = run_in_background(to_pdf, report, progress=lambda done: progress(0.65 + 0.35 * done, paper))
    made = MadeReport(html, pdf)
    result_cache().put(("report", digest, method), made)
    return made


def offer_report(place: DeltaGenerator, *, at_work: bool) -> None:
    """Draw the button; it is disabled while the report is made."""
    place.button(
        "Make the report",
        type="primary",
        key="make_report",
        disabled=at_work,
        on_click=lambda: st.session_state.update(report_asked=True),
    )


def asked_for_report() -> bool:
    """Whether the button was clicked since the last call."""
    return bool(st.session_state.pop("report_asked", False))


def make_report_at(
    place: DeltaGenerator, digest: str, method: str, analysis: Analysis, stem: str
) -> None:
    """Make the report, with progress by step and a way to stop, and show it."""
    with place.container():
        bar = st.progress(0.0, "Preparing")
        st.button("Stop", key="stop_report", help="Ends the work; nothing is kept of it.")
    try:
        made = write_report(digest, method, analysis, steps_at(bar))
    except JointIdError as error:
        show_error(error, place)
    else:
        show_report(place, made, stem)


def show_report(place: DeltaGenerator, made: MadeReport, stem: str) -> None:
    """Offer a report as files and for a look."""
    with place.container():
        with st.container(horizontal=True):
            download("Report as PDF", made.pdf, f"{stem}_report.pdf", "application/pdf", kind="primary")
            download("Report as HTML", made.html, f"{stem}_report.html", "text/html")
        with st.expander("Look at it"):
            preview(made.html, height=700)


def preview(html: str, *, height: int) -> None:
    """Show a report on the page, in a frame that can neither run scripts nor reach the app."""
    style = f"border:0;width:100%;height:{height}px;display:block"
    frame = f'<iframe sandbox title="The report" style="{style}" srcdoc="{escape(html)}"></iframe>'
    st.iframe(f'<body style="margin:0">{frame}</body>', height=height)
