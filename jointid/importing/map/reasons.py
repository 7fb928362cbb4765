"""Why an entry of a mapping is proposed as it is."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Reason:
    """Why one entry of a mapping was guessed as it is."""

    what: str
    """Which entry: "time", "joints", "position of joint 1", "gear ratio of joint 1" ..."""
    text: str
    """The reason as a sentence, or what the user should give."""
    sure: bool
    """False where the file does not say it: the user should look."""
