"""The introduction of a page, which explains its terms as the glossary does."""

import re
from functools import cache

import streamlit as st

from jointid.files.application import application_folder

_ENTRY = re.compile(r"^\*\*(.+?)\*\*: .*(?:\n.+)*", re.MULTILINE)
_SYMBOL = re.compile(r" [A-ZησJ][\w, ]*$")


@cache
def glossary() -> str:
    """Return the glossary of the documentation in Markdown, without its heading."""
    page = application_folder() / "docs" / "reference" / "glossary.md"
    return page.read_text("utf-8").partition("\n")[2]


def introduce(text: str) -> None:
    """Write a text; its hint explains the terms of the glossary that occur in it."""
    entries = [entry[0] for entry in _ENTRY.finditer(glossary()) if _occurs(entry[1], text)]
    more = "More terms: page Glossary."
    st.markdown(text, help="\n\n".join([*entries, more]) if entries else None)


def _occurs(term: str, text: str) -> bool:
    """Whether one of the names of a term, without its symbols, occurs in a text."""
    names = "|".join(map(re.escape, _SYMBOL.sub("", term).split(", ")))
    return re.search(rf"\b({names})s?\b", text, re.IGNORECASE) is not None
