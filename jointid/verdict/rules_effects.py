"""Rules of the verdict on deviations from the ideal model that are fitted along with K and D."""

import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from jointid.arrays import Floats
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.estimators.parameters import (
    CHANGES,
    EFFECTS,
    GEAR_LAWS,
    PARAMETERS,
    PERIODIC_EFFECTS,
)
from jointid.estimation.quantities import Quantity, quantities
from jointid.uncertainty.validation import amplitude_dependence, second_amplitude
from jointid.verdict.evidence import Evidence, Finding, note, number, warning
from jointid.verdict.rules_causes import (
    CANNOT_TELL,
    alternatives,
    half_a_sample,
    has_unmodelled_friction,
)
from jointid.verdict.rules_model import contradicts
from jointid.wording import (
    UNDETERMINED,
    capitalised,
    counted,
    enumerated,
    percent,
    significant,
    with_error,
)

_REMEDIES = {
    "arm_viscous": ("The arm has viscous friction", ""),
    "arm_coulomb": ("The arm has Coulomb friction", ""),
    "loss_factor": (
        "The gears have structural damping",
        "D contains the viscous part only. K is the stiffness at the geometric mean frequency of the "
        "records; it rises with frequency.",
    ),
    "lag": (
        "The torques {lag|lead} by different amounts",
        "Check the sampling and output times of each drive.",
    ),
    "position_filter": (
        "The positions {are filtered, or the torques are delayed by a filter"
        "|lead as if the torques were filtered}",
        "Log unfiltered positions if the drive allows it.",
    ),
    "torque_filter": (
        "The torques {are delayed by a filter, or the positions are filtered"
        "|lead, or their log is filtered}",
        "Log the torque set point, or the current without a filter, if the drive allows it.",
    ),
    "load": ("The motors have load-dependent friction", ""),
    "motor_presliding": ("The motors' friction has a presliding regime", ""),
    "ripple": ("The motors have torque ripple", ""),
    "transmission": (
        "The gears have a transmission error",
        "Where the motors turn little, it acts as a change of the gear ratio, whose size depends on the "
        "number of periods per turn. Records over a quarter of a turn or more determine it, and K, "
        "better.",
    ),
    "link": (
        "The links have resonances above the band",
        "K and D hold for the gears alone; a controller for higher frequencies needs the links as well.",
    ),
    "gravity": ("Gravity acts as a {restoring|destabilising} spring on the arm", ""),
    "cubic": (
        "A gear {hardens|softens}",
        "K is the tangent stiffness at zero torque. Measure at the amplitude of the application.",
    ),
    "piecewise": (
        "A gear has three slopes",
        "K is the tangent stiffness at zero torque. Measure at the amplitude of the application.",
    ),
    "backlash": (
        "A gear has backlash",
        "K is the tangent stiffness outside the backlash. Check the gear's preload.",
    ),
    "hysteresis": ("A gear has hysteresis", "K is the tangent stiffness without the hysteresis."),
}
"""Title, with {one verb|another} for positive and negative values, and remedy by effect."""


_CLEAR = 3.0
"""Standard errors from which different lags of the drives, and further changes, are reported."""
_BULGE = 1.5
"""Largest change of the gears over that from the first to the last record from which it is reported."""


def friction_changes(evidence: Evidence) -> Iterator[Finding]:
    """Friction that differs from record to record; none if the model contradicts the data."""
    fit = evidence.fit
    chosen = any(each.chosen and each.model.differs for each in fit.candidates)
    if not chosen or fit.friction is None or contradicts(fit):
        return
    changes: Floats = fit.friction.change * np.ones(fit.n)
    sizes = [f"{number(x, 2)} N·m (joint {j})" for j, x in enumerate(changes.tolist(), 1) if x > 0]
    between = f"Between records, its standard deviation is {enumerated(sizes)}. " if sizes else ""
    each = "segment of a motion" if fit.phasors.motion.any() else "record"
    yield note(
        "The friction of the motors changes",
        f"{between}The fit gives every {each} Coulomb and viscous friction of its own.",
        "No action needed. The friction of a warm robot changes less.",
        0.01,
    )


def gears_change(evidence: Evidence) -> Iterator[Finding]:
    """K or D that changes slowly over the records; none if the model contradicts the data."""
    fit = evidence.fit
    if contradicts(fit):
        return
    p, order = fit.parameters, np.arange(fit.parameters.vector.size)
    first, last = np.zeros(fit.n, int), np.full(fit.n, -1)
    by_frequency = bool(np.all(np.diff(fit.phasors.omega) >= 0)) and not evidence.has_motions
    changes_of_pose = sum(a != b for a, b in pairwise(evidence.poses))
    by_pose = 0 < changes_of_pose < len(set(evidence.poses))
    for name, of, symbol in zip(CHANGES, ("stiffness", "damping"), "KD", strict=True):
        if name not in p.layout:
            continue
        parts = np.array([order[p.layout[part]] for part in EFFECTS[name].parameters])
        share = fit.phasors.progress @ p.vector[parts]  # of each row and joint
        change, error = _between(fit, parts, first, last)
        largest, its_error = _between(fit, parts, share.argmin(axis=0), share.argmax(axis=0))
        bulges = (largest > _BULGE * np.abs(change)) & (largest > _CLEAR * its_error)
        each = zip(_shares(largest, its_error), bulges.tolist(), strict=True)
        within = enumerated([text for text, is_one in each if is_one] or [""])
        alike = f" The records are in order of frequency: {of} that depends on it looks the same."
        by_poses = f" The poses follow one after another: {of} that depends on the pose looks the same."
        yield warning(
            f"The {of} of the gears changes over the records",
            f"From the first record to the last it changes by {enumerated(_shares(change, error))}."
            f"{f' In between, it varies by up to {within}.' * bool(within)} {symbol} is its mean."
            f"{alike * by_frequency}{by_poses * by_pose}",
            "Warm the robot up before the experiment"
            f"{', and measure the frequencies in random order' * by_frequency}"
            f"{', and return to the first pose at the end' * by_pose}.",
            float(max(np.abs(change).max(), largest[bulges].max(initial=0.0))),
        )


def _between(
    fit: ElasticityFit, parts: np.ndarray, first: np.ndarray, last: np.ndarray
) -> tuple[Floats, Floats]:
    """Change of each joint's gear from one row to another by parameters (3, n), and its error."""
    apart = (fit.phasors.progress[last] - fit.phasors.progress[first]).T
    covariance = fit.parameter_covariance[parts[:, None], parts]
    variance = np.einsum("aj,abj,bj->j", apart, covariance, apart)
    change: Floats = (apart * fit.parameters.vector[parts]).sum(axis=0)
    return change, np.sqrt(np.maximum(variance, 0.0))


def _shares(changes: Floats, errors: Floats) -> list[str]:
    """Changes in per cent with their errors and joints."""
    each = enumerate(zip((100 * changes).tolist(), (100 * errors).tolist(), strict=True), 1)
    return [f"{with_error(*both)} % (joint {j})" for j, both in each]


def effects_found(evidence: Evidence) -> Iterator[Finding]:
    """Fitted effects with their sizes; none if the model contradicts the data."""
    fit = evidence.fit
    if contradicts(fit):
        return
    tried = False  # stated once
    for name, found in quantities(fit).items():
        if name not in _REMEDIES:
            continue
        law = "hardening" if name == "cubic" else name
        if name in GEAR_LAWS:
            found = tuple(q for q in found if law in fit.gears[q.joints[0] - 1].laws) or found
        per_turn = _orders(fit, name)
        found = tuple(q for q in found if per_turn.get(q.joints[0] - 1, 1))
        values = ", ".join(_value(fit, q, per_turn) for q in found)
        clearest = max(found, key=lambda q: abs(q.value) / (q.error if q.error > 0 else np.inf))
        if name == "lag" and abs(clearest.value) < _CLEAR * clearest.error:
            continue  # it is one of equally good models; the drives need no check
        title, remedy = _title(name, clearest), _REMEDIES[name][1]
        alike = alternatives(fit, name)
        twin = _TWINS.get(name, "") if clearest.value > 0 else ""  # named in the title
        laws = alike.keys() & GEAR_LAWS if name in GEAR_LAWS else set()  # of the gear in the title
        titles = (_title(law, clearest)[len("A gear ") :] for law in GEAR_LAWS if law in laws)
        title = " or ".join([title, *titles])
        others = " or ".join(text for part, text in alike.items() if part not in {twin, *laws})
        hold, changes = half_a_sample(evidence) if name in _TIMES else ("", [])
        if name in GEAR_LAWS and not tried:
            remedy, tried = f"{remedy} {_settled_by(evidence)}".strip(), True
        yield note(
            f"{title}, or there is {others}" if others else title,
            f"{capitalised(PARAMETERS[name].name)}: {values}. {CANNOT_TELL if alike else ''}"
            "The fit includes it.",
            hold or remedy,
            0.01,
            "",
            *changes,
        )


def depends_on_amplitude(evidence: Evidence) -> Iterator[Finding]:
    """The stiffness changes with the deflection; none if the model contradicts the data."""
    fitted = any(name in evidence.fit.parameters.layout for name in GEAR_LAWS)
    if fitted or np.any(evidence.fit.K <= 0) or contradicts(evidence.fit):
        return
    if has_unmodelled_friction(evidence):
        return
    found = amplitude_dependence(evidence.fit)
    clear = (np.abs(found.change) > 5 * found.standard_error) & (np.abs(found.change) > 5e-3)
    ratio = np.exp(found.change)
    for j in np.flatnonzero(clear):
        low, high = found.deflection_rad[j]
        verb = "rises" if found.change[j] > 0 else "falls"
        error = percent(ratio[j] * found.standard_error[j])
        yield warning(
            f"The stiffness of joint {j + 1} {verb} with the deflection",
            f"It changes by {percent(ratio[j] - 1)} ± {error} from a deflection of {number(low, 2)} rad "
            f"to {number(high, 2)} rad, at frequencies with several amplitudes.",
            "The gear is nonlinear, or friction is not fully modelled. Measure at the amplitude of the "
            "application.",
            float(abs(found.change[j])),
        )


def _title(name: str, found: Quantity) -> str:
    """Title of an effect by the sign of its value."""
    return re.sub(r"\{(.*)\|(.*)\}", r"\2" if found.value < 0 else r"\1", _REMEDIES[name][0])


def _orders(fit: ElasticityFit, name: str) -> dict[int, int]:
    """Periods per turn of a periodic effect by joint, from 0; empty for other effects."""
    if name not in PERIODIC_EFFECTS:
        return {}
    model = next(candidate.model for candidate in fit.candidates if candidate.chosen)
    return dict(enumerate(next(each.orders for each in model.per_turn if each.effect == name)))


def _value(fit: ElasticityFit, found: Quantity, per_turn: dict[int, int]) -> str:
    """Value of an effect at its joint; backlash also in arc minutes and relative to the deflection.

    Of periodic effects it is the amplitude.
    """
    (j,) = found.joints
    if per_turn:
        quadrature = fit.parameters[f"{found.parameter}_quadrature"][j - 1]
        found = replace(found, value=float(np.hypot(found.value, quadrature)))
    shown = found.shown[: 1 if found.shown[0] == UNDETERMINED else 2]
    text, gear = " ".join(shown).rstrip() + f" (joint {j}", fit.gears[j - 1]
    if per_turn:
        text += f", {counted(per_turn[j - 1], 'period')} per turn of its motor"
    if found.parameter in GEAR_LAWS:
        text = text.replace(" (joint", " at the motor (joint")  # whatever the unit of the answer
    if found.parameter == "backlash":
        text += f", {significant(np.degrees(60 * found.value), 3)} arcmin"
        text += f", {percent(gear.backlash_share)} of the peak-to-peak deflection"
    return f"{text})"


_TWINS = {"torque_filter": "position_filter", "position_filter": "torque_filter"}
_TIMES = ("lag", "position_filter", "torque_filter")
"""Effects that act like a delay."""


def _settled_by(evidence: Evidence) -> str:
    """Largest torques in the records, and the record that would distinguish two gear laws."""
    fit = evidence.fit
    tried = enumerated(
        [f"{significant(gear.tried_Nm, 2)} N·m (joint {j})" for j, gear in enumerate(fit.gears, start=1)]
    )
    largest = f"Largest torques of the gears in the records, at the motor: {tried}."
    return f"{largest} {second_amplitude(fit)}".strip()
