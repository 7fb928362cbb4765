"""The result of an identification as a sentence."""

from __future__ import annotations

from jointid.estimation.elasticity import ElasticityFit
from jointid.joints import Elasticity
from jointid.rounding import significant
from jointid.wording import capitalised, enumerated

_AGREEMENT = 0.01
"""Stiffnesses that differ by at most 1 % count as equal: the path error is then below 0.1 mm."""


def model_name(fit: ElasticityFit) -> str:
    """Return the fitted model: "elasticity", with " + friction" and " + delay" where fitted."""
    parts = {"elasticity": True, "friction": fit.friction, "delay": fit.delay}
    return " + ".join(name for name, part in parts.items() if part is not None)


def without(fit: ElasticityFit) -> str:
    """Return "without friction and delay", or whichever of these the fit found; empty for neither."""
    found = ["friction"] * (fit.friction is not None) + ["delay"] * (fit.delay is not None)
    return f"without {' and '.join(found)}" if found else ""


def answer_sentence(fit: ElasticityFit, nominal: Elasticity | None = None) -> str:
    """State the identified stiffnesses, relative to the nominal ones if these are given.

    Parameters
    ----------
    fit : ElasticityFit
    nominal : Elasticity, optional
        Values that the controller assumes.
    """
    unknown = [j for j in range(fit.n) if not fit.K[j] > 2 * fit.standard_error[j]]
    if unknown:
        which = enumerated([f"joint {j + 1}" for j in unknown])
        return f"These records do not tell the stiffness of {which}: see what was found below."
    if nominal is None:
        parts = [f"{_rounded(fit, j)} N·m/rad" for j in range(fit.n)]
        joints = enumerated([f"joint {j + 1}" for j in range(fit.n)])
        verb = "has a stiffness" if fit.n == 1 else "have stiffnesses"
        return f"{capitalised(joints)} {verb} of {enumerated(parts)}, seen from the motor."
    whole = {_compared(fit, nominal, j, short=False) for j in range(fit.n)}
    if fit.n > 1 and len(whole) == 1:
        return f"Every joint {whole.pop()}."
    parts = [f"joint {j + 1} {_compared(fit, nominal, j, short=j > 0)}" for j in range(fit.n)]
    return f"{capitalised(enumerated(parts))}."


def _compared(fit: ElasticityFit, nominal: Elasticity, j: int, *, short: bool) -> str:
    """Stiffness relative to the nominal one; ``short`` omits the reference."""
    ratio = float(fit.K[j] / nominal.K[j])
    uncertainty = 2 * float(fit.standard_error[j] / nominal.K[j])
    if abs(ratio - 1) <= max(_AGREEMENT, uncertainty):
        return "is as stiff as " + ("assumed" if short else "the controller assumes")
    if 0.67 < ratio < 1.5:
        kind = "stiffer" if ratio > 1 else "softer"
        tail = "" if short else " than the controller assumes"
        return f"is {significant(100 * abs(ratio - 1), 2)} % {kind}{tail}"
    tail = "" if short else " as the controller assumes"
    return f"is {significant(ratio, 2)} times as stiff{tail}"


def _rounded(fit: ElasticityFit, j: int) -> str:
    return significant(float(fit.K[j]), 3)
