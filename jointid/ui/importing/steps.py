"""The steps of an import as a list to open, with their state and missing entries."""

from collections.abc import Iterator
from contextlib import contextmanager

import streamlit as st

from jointid.ui.shared.messages import markdown_escape
from jointid.wording import unbroken

_STEPS = {
    "Logs": "",
    "Columns": "Which column is the time, and which are position and torque of each joint.",
    "Drive data": "Gear ratios, rated torques, directions: facts that no log states.",
    "Runs": "Sine runs and other motions are found in the log and can be corrected.",
    "Inertias": "Rotor and arm inertias, and how well they are known.",
}
"""Names of the steps, and what is shown in one that waits for an earlier one."""
LOGS, COLUMNS, DRIVES, RUNS, INERTIAS = STEPS = tuple(_STEPS)
_STATES, _OPEN, _GO_ON = "import_step_states", "import_open_step", "import_go_on"
_DONE, _TO_DO = ":material/check_circle:", ":material/radio_button_unchecked:"


def go_on() -> None:
    """Open the first step that is not done, at the end of the next run."""
    st.session_state[_GO_ON] = True


class Steps:
    """The list. A step's head shows the state that ``tell`` stated; a change draws the list again."""

    def __init__(self) -> None:
        self._shown: dict[str, tuple[bool, str]] = st.session_state.get(_STATES, {LOGS: (False, "")})
        self._states: dict[str, tuple[bool, str]] = {}

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Draw a step's head and what belongs to it; without ``tell``, the step waits for another."""
        opened, version = st.session_state.get(_OPEN, (LOGS, 0))
        done, text = self._shown.get(name, (False, ""))
        colour = "gray" if done else "orange"
        state = f" &nbsp; :{colour}[{unbroken(markdown_escape(text))}]" if text else ""
        with st.expander(
            f"**{STEPS.index(name) + 1} {name}**{state}",
            expanded=name == opened,
            # Another key: opened or closed as stated here, whatever was clicked before.
            key=f"step {name} {version}",
            type="step",
            icon=_DONE if done else _TO_DO,
        ):
            yield
            if name not in self._states:
                st.caption(_STEPS[name])

    def tell(self, name: str, done: bool, text: str) -> None:
        """State whether a step is done, and its content or missing entries."""
        self._states[name] = done, text
        if not done and st.session_state.get(_GO_ON, True):
            self._go_to(name)

    def finish(self, *, clicked: bool = False) -> None:
        """Draw the list again if its heads are out of date, but not over the answer to a click."""
        if st.session_state.get(_GO_ON, True):
            self._go_to(INERTIAS)
        if self._states != self._shown and not clicked:
            st.session_state[_STATES] = self._states
            st.rerun()

    def _go_to(self, name: str) -> None:
        opened, version = st.session_state.get(_OPEN, (LOGS, 0))
        st.session_state[_GO_ON] = False
        if opened != name:
            st.session_state[_OPEN] = name, version + 1
            st.session_state[_STATES] = self._shown | self._states
            st.rerun()
