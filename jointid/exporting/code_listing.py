"""K and D as a few lines of code, to paste into a controller or a script."""

from textwrap import wrap

import numpy as np

from jointid.analysis import NOT_USABLE, Analysis, Answer, ArmSideAnalysis
from jointid.answer import gear_text
from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.exporting.identification import answer_text, origin_text, stored, warning_text
from jointid.wording import enumerated, unbroken

_NAMES = {name: name for name in ("K", "K_std", "D", "D_std", "K_secant", "T_secant", "N")}
_GLOBAL_NAMES = {
    "K": "JointStiffness",
    "D": "JointDamping",
    "K_secant": "JointSecantStiffness",
    "T_secant": "JointSecantTorque",
    "N": "JointGearRatio",
}
"""Names in a global variable list, where K and D may have other meanings; errors are comments."""
_GLOBAL = "    {name} : {array}LREAL := {values};"
_ARRAYS = {"C": "[{n}]", "Structured Text": "ARRAY [1..{n}] OF "}
"""Declaration of a list, where it differs from that of a number."""
LANGUAGES = {
    "Text": ("", "{name} = {values}", ("", "", ", "), _NAMES, ()),
    "TOML": ("# ", "{name} = {values}", ("[", "]", ", "), _NAMES, ()),
    "Python": ("# ", "{name} = {values}", ("[", "]", ", "), _NAMES, ()),
    "MATLAB": ("% ", "{name} = {values};", ("[", "]", " "), _NAMES, ()),
    "C": ("// ", "static const double {name}{array} = {values};", ("{", "}", ", "), _NAMES, ()),
    "Structured Text": (
        *("// ", _GLOBAL, ("[", "]", ", "), _GLOBAL_NAMES),
        ("VAR_GLOBAL CONSTANT", "END_VAR"),
    ),
}
"""Beginning of a comment, a line of code, opening, closing and separator of a list, names, and the first
and last line of code if there are any, by language; Structured Text as in IEC 61131-3."""
ENDINGS = {".st": "Structured Text", ".c": "C", ".m": "MATLAB", ".py": "Python"}
"""Languages of files, by the ending of their name."""
_SECANT = (
    "K is the tangent stiffness at zero torque, outside any backlash. The secant stiffness (without "
    "backlash) holds at the secant torque in N·m, the largest torque in the records: use it as linear K "
    "for applications up to this torque"
)
_DIGITS = 7
_WIDTH = 80
"""Width of a comment, characters."""


def code_listing(analysis: Answer, language: str) -> str:
    """Write K and D with their standard errors in a language of ``LANGUAGES``.

    Also gear ratios where known, and the laws and secant stiffnesses of nonlinear gears. K of a joint
    alone where that of others is refused: a list with gaps misleads. Of an answer that is not usable,
    there are comments only.
    Raises JointIdError when the language is not supported.
    """
    if language not in LANGUAGES:
        known = enumerated(list(LANGUAGES))
        raise JointIdError(f"The language {language!r} is not supported: choose one of {known}.")
    comment, line, (opening, closing, separator), names, frame = LANGUAGES[language]
    study, rows = analysis.study, _rows(analysis)
    unusable = analysis.state == NOT_USABLE
    if unusable:
        frame, rows = (), {name: each for name, each in rows.items() if not np.isfinite(each).all()}
    name = " ".join(study.name.split()) or "study without a name"
    is_motor = isinstance(analysis, Analysis)
    facts = [
        warning_text(analysis, "The values are left out.") if unusable else f"{name}: {analysis.state}",
        name if unusable else " ".join(answer_text(analysis).split()),
        origin_text(analysis),
        f"{'Motor' if is_motor else 'Joint'} side; K in N·m/rad{', D in N·m·s/rad' * is_motor}; _std: "
        "one standard error",
    ]
    if isinstance(analysis, Analysis) and "K_secant" in rows:
        fit = analysis.fit
        gears = (j for j, gear in enumerate(fit.gears) if gear.kind != "linear")
        facts.append(_SECANT)
        facts += [f"Nonlinear gear of {gear_text(fit, j)}".replace("Joint", "joint", 1) for j in gears]
    if "N" in rows:
        facts.append("N: gear ratio, motor turns per joint turn; K at the joint is N² K, D is N² D")
    width = _WIDTH - len(comment)
    lines = [comment + part for fact in facts for part in _wrapped(fact, width)]
    lines += frame[:1]
    reasons = {}
    if isinstance(analysis, ArmSideAnalysis):
        reasons = {f"{j}": reason for j, reason in enumerate(analysis.fit.reasons, start=1)}
    for name, values in rows.items():
        joint = "".join(filter(str.isdigit, name))  # empty for a list of all joints
        what = name.replace(joint, "")
        code = line if what in names else f"{comment}{{name}}: {{values}}"
        if np.isfinite(values).all():
            shown = separator.join(map(_real, np.ravel(values).tolist()))
            array = "" if joint else _ARRAYS.get(language, "").format(n=values.size)
            known_as = name if names.get(what, what) == what else names[what] + joint
            shown = shown if joint else opening + shown + closing
            lines.append(code.format(name=known_as, array=array, values=shown))
        else:
            reason = reasons.get(joint, "not determined by the records")
            lines += [comment + part for part in _wrapped(f"{name}: {reason}", width)]
    lines += frame[1:]
    return "\n".join(lines) + "\n"


def _rows(analysis: Answer) -> dict[str, Floats]:
    """Values of all joints by their name, in the unit of files; of each joint where some are refused."""
    rows: dict[str, Floats] = {}
    found = stored(analysis).quantities
    if any(np.isnan(quantity.value) for quantity in found):
        for quantity in found:
            rows[quantity.name] = np.array(quantity.value)
            if np.isfinite(quantity.value):
                rows[f"{quantity.name}_std"] = np.array(quantity.error)
        return rows
    for name in ("K", "D"):
        if own := [quantity for quantity in found if quantity.parameter == name]:
            rows[name] = np.array([quantity.value for quantity in own])
            rows[f"{name}_std"] = np.array([quantity.error for quantity in own])
    gears = analysis.fit.gears if isinstance(analysis, Analysis) else ()
    if any(gear.kind != "linear" for gear in gears):
        rows["K_secant"] = np.array([gear.secant_K for gear in gears])
        rows["T_secant"] = np.array([gear.tried_Nm for gear in gears])
    if isinstance(analysis, Analysis) and analysis.study.gear_ratios is not None:
        rows["N"] = analysis.study.gear_ratios
    return rows


def _wrapped(text: str, width: int) -> list[str]:
    """Break a text into lines, but no number from its error and unit."""
    lines = wrap(unbroken(text), width, break_long_words=False)
    return [line.replace("\N{NO-BREAK SPACE}", " ").replace("\N{WORD JOINER}", "") for line in lines]


def _real(value: float) -> str:
    """Format a real literal of every language: with a decimal point, also before an exponent."""
    mantissa, e, exponent = f"{value:.{_DIGITS}g}".partition("e")
    return mantissa + ("" if "." in mantissa else ".0") + e + exponent
