"""The one Markdown escape: text from files and people, to be shown unchanged where Markdown is read.

Streamlit reads nearly every text as Markdown: messages, labels, help, progress, cells of ``st.table``.
"""

import re

__all__ = ["markdown_escape"]

_JOINER = "\N{WORD JOINER}"
"""Invisible. Addresses, icons and arrows are sought in the finished text, where no backslash helps."""
_ALWAYS = re.compile(r"[\\`*\[\]<$|~&]")
_UNDERSCORES = re.compile(r"(?<![^\W_])_+|_+(?![^\W_])")
_DIRECTIVE = re.compile(r":(?=[^\W\d_]|[:{])")
_FIRST = re.compile(r"^([-+=#>]|\d+(?=[.)](?:\s|$)))")
_SOUGHT = (
    re.compile(r"(?i)(?<=https:)(?=//)|(?<=http:)(?=//)|(?<=www)(?=\.)"),
    re.compile(r"(?<=@)(?=[-\w])"),
    re.compile(r"(?<=:)(?=(?:material/)?[-+\w]+:)"),
    re.compile(r"(?<=\s[-<>=~])(?=[->=]+(?:\s|$))|(?<=^[-<>=~])(?=[->=]+(?:\s|$))"),
)


def markdown_escape(text: object) -> str:
    """Return Markdown that shows a text unchanged, line by line.

    Parameters
    ----------
    text : object
        Anything; what ``str`` makes of it.

    Returns
    -------
    str
        No emphasis, link, image, address to click, formula, icon, colour or HTML comes of it. What
        Markdown would leave alone is left alone: names such as theta_m1_rad, numbers and units.
    """
    lines = (_line(line.strip()) for line in str(text).splitlines())
    return "  \n".join(line for line in lines if line)


def _line(text: str) -> str:
    for pattern in _SOUGHT:
        text = pattern.sub(_JOINER, text)
    text = _ALWAYS.sub(r"\\\g<0>", text)
    text = _UNDERSCORES.sub(lambda found: "\\_" * len(found[0]), text)
    text = _DIRECTIVE.sub(r"\\:", text)
    return _FIRST.sub(_first, text)


def _first(found: re.Match[str]) -> str:
    """Escape the start of a heading, a quotation or a list."""
    return f"{found[0]}{_JOINER}" if found[0].isdigit() else f"\\{found[0]}"
