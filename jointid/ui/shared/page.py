"""The beginning of every page: settings, sidebar, and the chosen study."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import streamlit as st

from jointid import Analysis, JointIdError, Phasors, Study
from jointid.figures.style import colours
from jointid.ui.shared import cached
from jointid.ui.shared.background import note_session, queue_said
from jointid.ui.shared.charts import choose_segment, is_dark, plot, side_by_side
from jointid.ui.shared.messages import show_error
from jointid.ui.shared.method_steps import ELASTICITY, IMPORT, RECORDS, SIMULATE
from jointid.ui.shared.refused_file import show_refused
from jointid.ui.shared.sidebar import choose_study
from jointid.ui.shared.workspace import open_study

_SIDE_BY_SIDE = 3
"""Joints whose figures are shown all at once."""
_ICON = Path(__file__).with_name("icon.svg")
# Contrast of 4.5 to 1 (WCAG AA) and a visible focus, where streamlit lacks them.
_STYLE = """
h2 { font-size: 1.75rem !important; }
[data-testid="stAlert"] h2 { font-size: 1.35rem !important; padding: 0 0 0.5rem; }
[data-testid="stCode"] code span { color: inherit !important; }
:is(a, button, input, textarea, summary, main, [tabindex]):focus-visible {
  outline: 2px solid %s !important; outline-offset: 1px; }
[data-testid="stMain"] [data-testid="stPageLink-NavLink"] p { text-decoration: underline; }
@media (max-width: 640px) {  /* two cards in a row on a phone; a value and its error in two lines */
  .modebar-container { display: none; }  /* always shown on a touch screen, over the legend */
  [data-testid="stTable"] td + td { min-width: 6rem; }
  [data-testid="stElementContainer"]:has(> [data-testid="stMetric"]) {
    width: calc(50%% - 0.5rem) !important; min-width: 0 !important; flex: none !important; }
  [data-testid="stMetric"] { padding: 0.6rem !important; min-width: 0 !important; }
  [data-testid="stMetric"] > div { padding: 0 !important; }
  [data-testid="stMetricValue"] { font-size: 0.9rem !important; }
  [data-testid="stMetric"] * { white-space: normal !important; overflow-wrap: anywhere; }
}
"""
_ON_PRIMARY = """
[data-testid^="stBaseButton-primary"], [data-testid^="stBaseButton-primary"] p { color: #10212C; }
"""


@dataclass(frozen=True, eq=False)
class Page:
    """The chosen study, and how it is shown."""

    key: str
    """The study's name in the list."""
    study: Study
    digest: str
    """Key for caches of results of this study."""
    method: str
    """The estimator chosen for the whole study."""
    unit: str
    """Unit of K and D, one of ``STIFFNESS_UNITS``."""
    dark: bool
    """Whether the theme is dark."""

    def analysis(self) -> Analysis:
        """Return the result of the whole method; without one, show the reason and end the page."""
        try:
            with queue_said():
                found = cached.analysis(self.digest, self.method, self.study)
        except JointIdError as error:
            _show_problem(error)
            if any(record.arm_rad is not None for record in self.study.motion_records):
                st.write("The sensors behind the gears give K of the joints:")
                st.page_link(ELASTICITY.path, label=ELASTICITY.name)
            st.stop()
        at_motor = self.study.gear_ratios is None and self.unit.endswith("joint")
        return found if at_motor else found.shown_in(self.unit)

    def drawn(self, what: str, draw: Callable[[], Any]) -> Any:
        """Return a figure of this study and estimator from the cache, or draw it.

        Parameters
        ----------
        what : str
            Identifies the figure within the study: its kind and everything it depends on.
        draw : callable
        """
        return _figure(self.digest, (self.method, self.unit, self.dark), what, draw)

    def show(self, what: str, draw: Callable[[], Any], description: str) -> None:
        """Show a figure from the cache, see ``drawn``, with a text for those who cannot see it."""
        plot(self.drawn(what, draw), description, key=what.split()[0])

    def show_per_joint(
        self,
        what: str,
        draw: Callable[[int], Any],
        description: str,
        *,
        heading: str = "**Joint {0}**",
    ) -> Sequence[int]:
        """Show one figure per joint, two side by side; of many joints, that of the chosen one.

        Parameters
        ----------
        what : str
            Identifies the figures, see ``drawn``.
        draw : callable
            Draws the figure of a joint, from 0.
        description, heading : str
            Alternative text and heading, with {0} for the joint's number.

        Returns
        -------
        sequence of int
            The joints drawn.
        """
        joints = self.joints("joint")
        for j, place in zip(joints, side_by_side(len(joints)), strict=True):
            with place:
                if heading and len(joints) > 1:
                    st.markdown(heading.format(j + 1))
                figure = self.drawn(f"{what} {j}", partial(draw, j))
                plot(figure, description.format(j + 1), key=f"{what} {j}")
        return joints

    def joints(self, key: str) -> Sequence[int]:
        """Return the joints to draw: all of a few, of many the one that a choice selects."""
        n = self.study.inertia.n
        if n <= _SIDE_BY_SIDE:
            return range(n)
        return [choose_segment("Joint", range(n), key, format_func=lambda j: f"Joint {j + 1}")]

    def phasors(self) -> Phasors:
        """Return the phasors; without them, show the reason and end the page."""
        try:
            return cached.phasors(self.digest, self.study)
        except JointIdError as error:
            _show_problem(error)
            st.stop()


@st.cache_resource(max_entries=400, show_spinner=False)
def _figure(digest: str, shown: tuple[str, str, bool], what: str, _draw: Callable[[], Any]) -> Any:
    return _draw()


def start(title: str) -> None:
    """Set up a page that needs no study, with its sidebar."""
    _set_up(title)
    choose_study()
    show_refused()


def _set_up(title: str) -> None:
    note_session()
    st.set_page_config(page_title=f"{title} · jointid", page_icon=str(_ICON), layout="wide")
    dark = is_dark()
    style = _STYLE % colours(dark).identified + (_ON_PRIMARY if dark else "")
    st.html(f"<style>{style}</style>")


def open_page(title: str) -> Page:
    """Begin a page about the chosen study; without one, offer ways to get one and end.

    Parameters
    ----------
    title : str
        For the browser's tab; the page writes its own heading.
    """
    _set_up(title)
    choice = choose_study()
    show_refused()
    if choice is None:
        st.title("No study yet")
        st.write(
            "There are no sample studies beside the app. Open a .zip in the sidebar, or make records:"
        )
        st.page_link(SIMULATE.path, label=SIMULATE.name)
        st.page_link(IMPORT.path, label=IMPORT.name)
        st.stop()
    key, method, unit = choice
    try:
        opened = open_study(key)
    except JointIdError as error:
        st.title(title)
        show_error(error)
        st.stop()
    return Page(key, opened.study, opened.digest, method, unit, is_dark())


def _show_problem(error: JointIdError) -> None:
    show_error(error)
    st.write("The records themselves can still be looked at:")
    st.page_link(RECORDS.path, label=RECORDS.name)
