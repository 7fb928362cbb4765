"""Number formatting with the digits that the uncertainty supports."""

import math

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_MOST_DIGITS = 7
"""Most significant digits shown, whatever the standard error."""
UNDETERMINED = "not determined"
"""In place of a value whose standard error is infinite."""


def with_error(value: float, error: float) -> str:
    """Format a value with its standard error, for instance "43.02 ± 0.03".

    The error gets one digit, two when it begins with 1; the value ends at the same place.

    Parameters
    ----------
    value : float
    error : float
        Standard error, not negative.

    Returns
    -------
    str
        Very small and very large values as "(1.20 ± 0.03)×10⁻⁷"; "not determined" for an infinite
        error, "± ?" for an unknown one (NaN).
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
    if not -3 <= exponent < 6 and exponent > -300:
        inner = with_error(value / 10.0**exponent, error / 10.0**exponent)
        return f"({inner})×10{str(exponent).translate(_SUPERSCRIPTS)}"
    place = exponent + 1 - _MOST_DIGITS  # power of ten of the last digit that is ever shown
    if error < 0.5 * 10.0**place:
        known = f"{_fixed(value, place)} ± "
        return known + (f"<{_fixed(10.0**place, place)}" if error > 0 else "0")
    place = max(place, _last_place(error))
    return f"{_fixed(value, place)} ± {_fixed(error, place)}"


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


def plain(value: float) -> str:
    """Format a chosen number, such as a nominal value: 20, 3.5, 0.015."""
    mantissa = f"{value:.6g}"
    return significant(value, 3) if "e" in mantissa else minus(mantissa)


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


def minus(text: str) -> str:
    """Return a number's text with the minus sign in place of hyphens."""
    return text.replace("-", "−")
