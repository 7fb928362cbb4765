"""Words and numbers of messages, reports and file names."""

import difflib
import math
import re
from collections.abc import Container, Iterable, Sequence

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_MOST_DIGITS = 7
"""Most significant digits shown, whatever the standard error."""
_WITHIN_NUMBER = re.compile(
    r"(?<=\d) (?=[%°±×]|[mµ]m\b|ms\b|Hz\b|rad\b|N·m|kg·m)|(?<=[±×]) |(?<=\b[KD]\d) (?=\d)"
)
_RANGE = re.compile(r"(?<=\d)–(?=\d)")
UNDETERMINED = "not determined"
"""In place of a value whose standard error is infinite."""


def nearest(word: str, words: Iterable[str]) -> str:
    """Return " Did you mean …?" with the most similar of ``words``, or nothing."""
    matches = difflib.get_close_matches(word[:200], [candidate[:200] for candidate in words], n=1)
    return f' Did you mean "{matches[0]}"?' if matches else ""


def capitalised(text: str) -> str:
    """Return a text with its first letter in upper case, the others as they are."""
    return text[:1].upper() + text[1:]


def free_name(name: str, taken: Container[str]) -> str:
    """Return the name, or the first of "name (2)", "name (3)" that is not taken."""
    free, number = name, 1
    while free in taken:
        number += 1
        free = f"{name} ({number})"
    return free


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


def joints_text(joints: Iterable[int]) -> str:
    """Return "joint 1", "joints 1 and 2", "joints 1, 2 and 3"; they count from 1."""
    numbers = [f"{j}" for j in joints]
    return f"joint{'s' * (len(numbers) > 1)} {enumerated(numbers)}"


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


def with_error(value: float, error: float, *, finest: int | None = None) -> str:
    """Format a value with its standard error, not negative, for instance "43.02 ± 0.03".

    The error gets one digit, two when it begins with 1; the value ends at the same place. Very small and
    very large values read "(1.20 ± 0.03)×10⁻⁷"; an infinite error gives "not determined", an unknown one
    (NaN) "± ?". ``finest`` is the power of ten of the last digit that has a meaning: with -1, an error
    of 0.006 is rounded up to "± 0.1".
    """
    if error == math.inf:
        return UNDETERMINED
    if not math.isfinite(value):
        return "unknown"
    if math.isnan(error):
        return f"{significant(value, 3)} ± ?"
    if error < 0:
        raise ValueError(f"error = {error:g}: a standard error is not negative.")
    if value == 0 and error == 0:
        return "0 ± 0"
    exponent = decimal_place(max(abs(value), error))
    if not -3 <= exponent < 6 and exponent > -300 and finest is None:
        inner = with_error(value / 10.0**exponent, error / 10.0**exponent)
        return f"({inner})×10{str(exponent).translate(_SUPERSCRIPTS)}"
    place = exponent + 1 - _MOST_DIGITS  # power of ten of the last digit that is ever shown
    if finest is not None:
        place = max(place, finest)
    if error < 0.5 * 10.0**place:
        return f"{_fixed(value, place)} ± {_fixed(10.0**place, place) if error > 0 else '0'}"
    place = max(place, _last_place(error))
    return f"{_fixed(value, place)} ± {_fixed(error, place)}"


def length_with_error(length_m: float, error_m: float) -> str:
    """Format a length on the tool's path in mm, below 0.1 mm in µm; to 0.1 µm at the finest."""
    if error_m == math.inf:
        return UNDETERMINED
    unit, times, finest = ("mm", 1e3, -4) if max(abs(length_m), error_m) >= 1e-4 else ("µm", 1e6, -1)
    return f"{with_error(times * length_m, times * error_m, finest=finest)} {unit}"


def significant(value: float, digits: int = 4) -> str:
    """Format a value with a number of significant digits, "1.23×10⁻⁵"."""
    if not math.isfinite(value):
        return "∞" if value == math.inf else "unknown"
    if value == 0:
        return "0"
    mantissa, _, power = f"{value:.{digits - 1}e}".partition("e")
    exponent = int(power)
    if -4 <= exponent < max(digits, 5):
        return minus(f"{float(f'{mantissa}e{power}'):.{max(0, digits - 1 - exponent)}f}")
    return minus(f"{mantissa}×10{str(exponent).translate(_SUPERSCRIPTS)}")


def three_digits(values: Iterable[float]) -> str:
    """Return numbers with three significant digits and commas between them."""
    return ", ".join(significant(float(value), 3) for value in values)


def percent(share: float) -> str:
    """Return the size of a share or relative error in per cent, with two digits."""
    if not math.isfinite(share):
        return UNDETERMINED
    size = 100 * abs(share)
    if size > 1000:
        return "more than 1000 %"
    return f"{size:.0f} %" if size >= 10 else f"{significant(size, 2)} %"


def signed_percent(change: float) -> str:
    """Return a change in per cent with its sign, "–" where it is not known."""
    if not math.isfinite(change):
        return "–"
    size = f"{abs(change):.0f}" if abs(change) >= 10 else significant(abs(change), 2)
    return f"{'+' if change > 0 else '−'}{size} %" if change else "0 %"


def plain(value: float) -> str:
    """Format a chosen number, such as a nominal value: 20, 3.5, 0.015."""
    mantissa = f"{value:.6g}"
    return significant(value, 3) if "e" in mantissa else minus(mantissa)


def chosen(values: Iterable[float]) -> str:
    """Return chosen numbers with commas between them, of up to four digits: "20, 3.5"."""
    return ", ".join(plain(float(f"{value:.4g}")) for value in values)


def _last_place(error: float) -> int:
    first = decimal_place(error)
    leading = round(error / 10.0**first, 1)
    if leading >= 9.5:  # 0.097 rounds to 0.1, which begins with 1
        return first
    return first - 1 if leading < 2 and round(error / 10.0 ** (first - 1)) < 20 else first


def decimal_place(value: float) -> int:
    """Power of ten of a number's first digit; 0 for zero."""
    return math.floor(math.log10(abs(value))) if value != 0 else 0


def _fixed(value: float, place: int) -> str:
    rounded = round(value, -place) + 0.0  # no "-0"
    return minus(f"{rounded:.{max(0, -place)}f}")


def unbroken(text: str) -> str:
    """Keep every number or range, its name, error and unit on one line, for a phone's width."""
    return _RANGE.sub("–\N{WORD JOINER}", _WITHIN_NUMBER.sub("\N{NO-BREAK SPACE}", text))


def printable(text: str) -> str:
    """Return text with a blank for each unprintable character."""
    return "".join(c if c.isprintable() else " " for c in text)


def minus(text: str) -> str:
    """Return a number's text with the minus sign in place of hyphens."""
    return text.replace("-", "−")
