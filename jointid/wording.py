"""Pieces of text that messages, reports and file names share."""

import difflib
from collections.abc import Iterable, Sequence


def nearest(word: str, words: Iterable[str]) -> str:
    """Return " Did you mean …?" with the most similar of ``words``, or nothing."""
    matches = difflib.get_close_matches(word[:200], [candidate[:200] for candidate in words], n=1)
    return f' Did you mean "{matches[0]}"?' if matches else ""


def capitalised(text: str) -> str:
    """Return a text with its first letter in upper case, the others as they are."""
    return text[:1].upper() + text[1:]


def file_stem(name: str) -> str:
    """Return a study's name as the beginning of a file name: lower case, words joined by "_"."""
    kept = "".join(c if c.isalnum() else "_" for c in name.lower())
    return "_".join(part for part in kept.split("_") if part)[:60] or "study"


def counted(count: int, what: str) -> str:
    """Return "1 record", "2 records", "2 frequencies": a number with its noun."""
    if count == 1:
        return f"1 {what}"
    plural = what[:-1] + "ies" if what.endswith("y") else what + "s"
    return f"{count} {plural}"


def enumerated(words: Sequence[str]) -> str:
    """Return "a", "a and b", "a, b and c"."""
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]


def listed(words: Iterable[str], *, at_most: int = 20) -> str:
    """Return words as one line for a message, shortened when there are many."""
    words = list(words)
    shown = ", ".join(word if len(word) <= 60 else word[:60] + "…" for word in words[:at_most])
    more = f", … ({len(words) - at_most} more)" if len(words) > at_most else ""
    return (shown or "none") + more


def shown(value: object) -> str:
    """Return a value from a file as a short piece of a message.

    Tables and lists are named, not printed: a file can nest them too deeply for that.
    """
    if isinstance(value, dict | list):
        return "a table" if isinstance(value, dict) else "a list"
    if isinstance(value, int) and value.bit_length() > 128:
        return "a very large integer"  # Python refuses to print the largest
    return f"{value!r:.60}"
