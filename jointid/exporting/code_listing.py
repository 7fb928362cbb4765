"""K and D as a few lines of code, to paste into a controller or a script."""

from collections.abc import Sequence

import numpy as np

from jointid.errors import JointIdError
from jointid.exporting.identification import Identification
from jointid.wording import enumerated

LANGUAGES = {
    "Text": ("", "{name} = {values}", ("", "", ", ")),
    "TOML": ("# ", "{name} = {values}", ("[", "]", ", ")),
    "Python": ("# ", "{name} = {values}", ("[", "]", ", ")),
    "MATLAB": ("% ", "{name} = {values};", ("[", "]", " ")),
    "C": ("// ", "static const double {name}[{n}] = {values};", ("{", "}", ", ")),
    "Structured Text": ("// ", "{name} : ARRAY[1..{n}] OF LREAL := {values};", ("[", "]", ", ")),
}
"""Beginning of a comment, a line of code, and opening, closing and separator of a list, by language."""
_DIGITS = 7


def code_listing(found: Identification, language: str) -> str:
    """Write K and D with their standard errors in a language of ``LANGUAGES``.

    Of an answer that is not usable, every line is a comment. Raises JointIdError when the language is
    not supported.
    """
    if language not in LANGUAGES:
        known = enumerated(list(LANGUAGES))
        raise JointIdError(f"The language {language!r} is not supported: choose one of {known}.")
    comment, line, brackets = LANGUAGES[language]
    unusable = "" if found.is_usable else comment or "# "
    study = " ".join(found.obtained.study.split()) or "study without a name"
    answer = " ".join(found.answer.split())
    facts = [
        f"NOT USABLE, the values are comments: {answer}" if unusable else "",
        f"{study}: {found.state or 'state unknown'}; jointid {found.obtained.version}",
        "" if unusable else answer,
        "Motor side; K in N·m/rad, D in N·m·s/rad; _std: one standard error from all causes",
    ]
    lines = [f"{comment}{fact}" for fact in facts if fact]
    n, error = found.n, found.standard_error
    rows = {"K": found.K, "K_std": error[:n], "D": found.D, "D_std": error[n:]}
    for name, values in rows.items():
        if np.isfinite(values).all():
            lines.append(
                unusable + line.format(name=name, n=n, values=_list(values.tolist(), *brackets))
            )
        else:
            lines.append(f"{comment}{name}: not determined by the records")
    return "\n".join(lines) + "\n"


def _list(values: Sequence[float], opening: str, closing: str, separator: str) -> str:
    return opening + separator.join(f"{value:.{_DIGITS}g}" for value in values) + closing
