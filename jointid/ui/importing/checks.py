"""Guesses of a mapping: their reasons, and a tick box for each that a log cannot prove."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from hashlib import blake2b

import streamlit as st

from jointid.importing import Guess
from jointid.importing.map.reasons import Reason
from jointid.ui.shared.markdown_escape import markdown_escape
from jointid.wording import capitalised

_HOW = (
    "What is marked To check is not in the log. Look it up in the controller's manual, or ask who "
    "recorded the log; then tick it."
)
_LATER = (
    "A side, unit or gear ratio that is off shows in the study's verdict as well, because M and M2 then "
    "do not fit the torque; a torque that is held after all shows as a torque lag."
)
_CALM = ("side", "scale", "gear ratio", "unit of position", "unit of torque", "torque hold")
"""Questions that need no look at the columns; their entries are named in the mapping's summary."""


class Checks:
    """The reasons of a guess, drawn where the page asks for them."""

    def __init__(self, guess: Guess, key: str) -> None:
        self._key = key
        self._reasons = {reason.what: reason for reason in guess.reasons}
        self.sure: list[str] = []
        """Reasons that need no look."""
        self.assumed: list[str] = []
        """Ratios and scales left at 1."""
        self.unsure: list[str] = []
        """Other guesses marked "To check"."""

    def add(self, reasons: Iterable[Reason]) -> None:
        """Add the reasons of later proposals."""
        self._reasons |= {reason.what: reason for reason in reasons}

    def show_instructions(self) -> None:
        """Explain the mark, if anything is marked."""
        if self.unsure or self.assumed:
            st.caption(_HOW)

    @property
    def columns_are_open(self) -> bool:
        """Whether there is a question about which column is what, or how long a sample is."""
        return any(not r.sure and not r.what.startswith(_CALM) for r in self._reasons.values())

    def ask(
        self, name: str, *entries: tuple[str, bool], part_of: str = "", assumed: Sequence[str] = ()
    ) -> None:
        """Show uncertain guesses with a tick box, and collect the other reasons.

        Parameters
        ----------
        name : str
            Subject of the box: "joint 1".
        *entries : tuple of str and bool
            Entries, and whether each is as guessed; only then its reason applies.
        part_of : str, optional
            End of the entries' names that ``name`` says already.
        assumed : sequence of str, optional
            Ratios and scales of this part that are 1.
        """
        found = [
            self._reasons[what] for what, as_guessed in entries if as_guessed and what in self._reasons
        ]
        self.sure += [_said(r) for r in found if r.sure]
        check = [reason for reason in found if not reason.sure]
        text = " ".join(_said(reason, part_of) for reason in check)
        if check and self._ticked(name, text):
            return
        self.assumed += assumed
        self.unsure += [r.what for r in check if not r.what.startswith(("gear ratio", "scale"))]

    def _ticked(self, name: str, text: str) -> bool:
        """Draw the question and return whether it is ticked; a changed question starts unticked."""
        left, right = st.columns([4, 1.3], vertical_alignment="center")
        question = blake2b(f"{name} {text}".encode(), digest_size=8).hexdigest()
        ticked = right.checkbox(
            f"Checked: {name}",
            key=f"import checked {question} {self._key}",
            help=f"{_HOW} {_LATER}",
            persist_state="session",
        )
        left.caption(f"{':gray-badge[Checked]' if ticked else ':orange-badge[To check]'} {text}")
        return ticked


def _said(reason: Reason, part_of: str = "") -> str:
    """A reason in Markdown, under the name of its entry."""
    name = capitalised(reason.what.removesuffix(part_of))
    return f"**{markdown_escape(name)}:** {markdown_escape(reason.text)}"
