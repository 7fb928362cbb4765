"""The beginning of every page: settings, sidebar, and the chosen study."""

from collections.abc import Callable, Hashable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import pandas  # noqa: F401 - before any figure: plotly uses it half imported in another thread
import streamlit as st

from jointid import Analysis, JointIdError, Phasors, Study, analyse, extract_phasors
from jointid.analysis import (
    MOTORS_ALONE,
    Answer,
    ArmSideAnalysis,
    analyse_arm_side,
    answer_of,
    reanalysed,
)
from jointid.background.pool import StoppedError
from jointid.figures.style import colours
from jointid.ui.shared.charts import FEW_JOINTS, choose_joint, introduce, is_dark, plot, side_by_side
from jointid.ui.shared.messages import markdown_escape, show_error, show_info
from jointid.ui.shared.method_steps import ELASTICITY, IMPORT, RECORDS, REPORT, SIMULATE
from jointid.ui.shared.recent_studies import link_to_last_on_a_phone
from jointid.ui.shared.results import Computation, awaited, note_session, result_cache
from jointid.ui.shared.settings import DEFAULT_METHOD
from jointid.ui.shared.sidebar import choose_study, remember_file
from jointid.ui.shared.workspace import label, link_to, open_sample, open_study, sample_paths

Given = ParamSpec("Given")
Found = TypeVar("Found")
Shown = TypeVar("Shown", bound=Answer)
_ABOUT_MOTIONS = (
    "If motions give no answer:\n"
    "- State the band in which the motor moves: `band_hz` of the record in study.toml.\n"
    "- Record longer, sample faster, or move in a wider band that includes the resonance; several "
    "records help.\n"
    "- Try the motion on a simulated robot first:"
)
_CHOICES = "chosen", "estimator"
"""Keys in the session of the choices that an answer depends on."""
_ICON = Path(__file__).with_name("icon.svg")
_CSS = Path(__file__).with_name("page.css").read_text("utf-8")


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

    @property
    def label(self) -> str:
        """The study's name as the list shows it."""
        return label(self.key)

    def answer(
        self,
        *,
        otherwise: Callable[[], object] | None = None,
        ask: Callable[[], object] | None = None,
    ) -> Analysis | ArmSideAnalysis:
        """Return all that the study gives, see ``answer_of``; without an answer as ``analysis``.

        ``ask`` asks for what sensors behind the gears lack.
        """
        return self._shown(self.answered, otherwise, ask)

    def analysis(self) -> Analysis:
        """Return the result of the whole method; without one, show the reason and end the page."""
        return self._shown(self.analysed)

    def _shown(
        self,
        compute: Callable[[], Shown],
        otherwise: Callable[[], object] | None = None,
        ask: Callable[[], object] | None = None,
    ) -> Shown:
        """A result in the unit of choice; without one, show the reason and end the page.

        ``otherwise`` shows what the page has without a result.
        """
        try:
            found = compute()
        except JointIdError as error:
            refused = compute == self.answered and self.study.robot_model is not None
            if self.study.has_sensors and not refused:
                if ask is None:
                    st.write("The sensors behind the gears can give K of the joints:")
                    link_to(ELASTICITY)
                else:
                    ask()
                show_info(f"{MOTORS_ALONE}. {str(error).removeprefix(f'{MOTORS_ALONE}. ')}")
            else:
                show_error(error)
            _point_to_records()
            if self.study.motion_records:
                st.markdown(_ABOUT_MOTIONS)
                link_to(SIMULATE)
            if otherwise is None:
                st.write("The study can be saved:")
                link_to(REPORT)
            else:
                otherwise()
            st.stop()
        at_motor = self.study.gear_ratios is None and self.unit.endswith("joint")
        return found if at_motor and isinstance(found, Analysis) else found.shown_in(self.unit)

    def answered(self) -> Analysis | ArmSideAnalysis:
        """Return all that the study gives, not in the unit of choice. Raises JointIdError without."""
        return answer_of(self.study, lambda _: self.analysed(), lambda _: self.sensors())

    def sensors(self) -> ArmSideAnalysis:
        """Return K from sensors behind the gears. Raises JointIdError as ``analyse_arm_side``."""
        doing = "Evaluating the sensors behind the gears"
        return self.computed("arm side", doing, analyse_arm_side, self.study)

    def analysed(self) -> Analysis:
        """Return the result of the whole method, motor side. Raises JointIdError as ``analyse``."""
        doing = "Fitting sines, identifying K and D"
        known = replace(self, method=DEFAULT_METHOD).computed("analysis", doing, analyse, self.study)
        if self.method != DEFAULT_METHOD:
            known = self.computed("analysis", doing, reanalysed, self.study, known, self.method)
        st.session_state["answered"] = {key: st.session_state[key] for key in _CHOICES}
        return known

    def begin(
        self,
        what: Hashable,
        compute: Callable[Given, Found],
        *given: Given.args,
        **named: Given.kwargs,
    ) -> Computation[Found]:
        """Begin a computation on this study and estimator, unless it has begun or its result is kept.

        ``what`` identifies the result: its kind, and all settings on which it depends; for ``compute``
        see ``run_in_background``.
        """
        return result_cache().begin((what, self.digest, self.method), compute, *given, **named)

    def computed(
        self,
        what: Hashable,
        doing: str,
        compute: Callable[Given, Found],
        *given: Given.args,
        **named: Given.kwargs,
    ) -> Found:
        """Return a result of ``begin``; meanwhile the page shows ``doing``. Raises as ``compute``.

        A long computation can be stopped; the page then shows the last answer, or ends here.
        """
        key = self.digest, self.method, what
        if st.session_state.get("stopped") == key:
            show_info(f"{doing}: stopped.")
            st.button("Resume", key="resume", on_click=st.session_state.pop, args=("stopped",))
            st.stop()
        while True:  # again if it was stopped elsewhere
            begun = self.begin(what, compute, *given, **named)
            awaited(doing, begun, stop=partial(_stop, begun, key))
            with suppress(StoppedError):
                return begun.result()

    def drawn(self, what: str, draw: Callable[..., Any]) -> Any:
        """Return a figure of this study and estimator from the cache, or draw it.

        ``what`` identifies the figure within the study: its kind and everything it depends on. ``draw``
        takes ``dark``, as all functions of ``jointid.figures`` do.
        """
        return _figure(self.digest, (self.method, self.unit, self.dark), what, draw)

    def show(self, what: str, draw: Callable[..., Any], description: str) -> None:
        """Show a figure from the cache, see ``drawn``, with a text for those who cannot see it."""
        plot(self.drawn(what, draw), description, key=what.split()[0])

    def show_per_joint(
        self,
        what: str,
        draw: Callable[..., Any],
        description: str,
        *,
        caption: str = "",
    ) -> Sequence[int]:
        """Show one figure per joint, two side by side; of many joints, that of the chosen one.

        ``draw`` takes a joint, from 0, and ``dark``; for ``what`` see ``drawn``. The alternative text
        ``description`` has {0} for the joint's number; ``caption`` is above all.
        Returns the joints drawn.
        """
        if caption:
            st.caption(caption)
        joints: Sequence[int] = range(self.study.inertia.n)
        if len(joints) > FEW_JOINTS:
            joints = [choose_joint(joints, "joint")]
        for j, place in zip(joints, side_by_side(len(joints)), strict=True):
            with place:
                if len(joints) > 1:
                    st.markdown(f"**Joint {j + 1}**")
                figure = self.drawn(f"{what} {j}", partial(draw, j))
                plot(figure, description.format(j + 1), key=f"{what} {j}")
        return joints

    def sine_phasors(self) -> Phasors:
        """Return the phasors of the sines, those of the analysis if it is kept. Raises JointIdError."""
        kept: Analysis | None = result_cache().get(("analysis", self.digest, DEFAULT_METHOD))
        if kept is not None:
            return kept.phasors
        return self.computed("phasors", "Fitting sines", extract_phasors, self.study.sine_records)

    def phasors(self) -> Phasors:
        """Return the phasors, also of records that do not determine the springs.

        Without them, show the reason and end the page.
        """
        try:
            return self.sine_phasors()
        except JointIdError as error:
            show_error(error)
            _point_to_records()
            st.stop()


def _stop(begun: Computation[Any], key: Hashable) -> None:
    """Stop a computation, and go back to the choice of study and estimator that has an answer."""
    begun.stop.set()
    answered: dict[str, Any] = st.session_state.get("answered", {})
    if any(st.session_state[name] != choice for name, choice in answered.items()):
        st.session_state.update(answered)
    else:
        st.session_state["stopped"] = key


@st.cache_resource(max_entries=600, show_spinner=False)  # a dozen of each of fifty people
def _figure(digest: str, shown: tuple[str, str, bool], what: str, _draw: Callable[..., Any]) -> Any:
    return _draw(dark=shown[2])


def start(title: str, introduction: str = "", *, heading: bool = True) -> tuple[str, str, str] | None:
    """Begin a page with its sidebar and heading; return the choices of the sidebar.

    ``title`` is for the browser's tab and, unless the page writes its own, the heading; ``introduction``
    states what the page shows, in two sentences.
    """
    note_session()
    remember_file()
    st.set_page_config(page_title=f"{title} · jointid", page_icon=str(_ICON), layout="wide")
    dark = is_dark()
    ink = f"--focus: {colours(dark).identified}; --on-primary: {'#10212C' if dark else '#FFFFFF'}"
    st.html(f"<style>:root {{ {ink}; }}\n{_CSS}</style>")
    choice = choose_study()
    link_to_last_on_a_phone()
    _show_notices()
    if heading:
        st.title(title, anchor=False)
        if introduction:
            introduce(introduction)
    return choice


def _show_notices() -> None:
    """Show that a study was not found, and the last refused file until it is dismissed."""
    shown, wanted = st.session_state.get("not_found", (None, ""))
    if wanted and shown == st.session_state["chosen"]:
        show_info(
            f"{wanted} is not, or no longer, in this workspace. The page shows another study: open "
            "the file again."
        )
    if "refused" not in st.session_state:
        return
    file, message, lines = st.session_state["refused"]
    st.error(f"**{markdown_escape(file)} was not opened.** {markdown_escape(message)}")
    if lines:
        st.code(lines, language=None)
    st.button("Dismiss", key="dismiss_refused", on_click=lambda: st.session_state.pop("refused", None))
    st.divider()


def open_page(title: str, introduction: str = "", *, heading: bool = True) -> Page:
    """Begin a page about the chosen study, see ``start``; without one, offer ways to get one and end."""
    choice = start(title, introduction, heading=heading)
    if choice is None:
        (st.header if heading else st.title)("No study yet", anchor=False)
        st.write("The app has no sample studies. Open a .zip in the sidebar, or create a study:")
        link_to(SIMULATE)
        link_to(IMPORT)
        st.stop()
    key, method, unit = choice
    try:
        opened = open_study(key)
    except JointIdError as error:
        if not heading:
            st.title(title)
        show_error(error)
        st.stop()
    return Page(key, opened.study, opened.digest, method, unit, is_dark())


def analyse_first_sample() -> None:
    """Analyse the sample that the bare address shows, if there is one, before anybody asks for it."""
    for name in list(sample_paths())[:1]:
        opened = open_sample(name)
        page = Page(name, opened.study, opened.digest, DEFAULT_METHOD, unit="", dark=False)
        page.begin("analysis", analyse, opened.study).result()


def _point_to_records() -> None:
    st.write("The records themselves can still be viewed:")
    link_to(RECORDS)
