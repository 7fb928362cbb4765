"""Reasons for the entries of a guessed mapping."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Reason:
    """Reason for one entry of a guessed mapping."""

    what: str
    """The entry: "time", "joints", "position of joint 1", "gear ratio of joint 1" ..."""
    text: str
    """The reason as a sentence, or the value that the user should give."""
    sure: bool = False
    """False where the file does not state it and the user should check."""


def scale_reason(channel: str, unit: str, meaning: str) -> Reason:
    """Return the reason for the scale of a channel, such as "torque of joint 1"."""
    text = f'The unit "{unit}" needs a scale ({meaning}); 1 is assumed. Give it.'
    return Reason(f"scale of {channel}", text)
