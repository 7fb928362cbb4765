"""The result of an identification in words."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from jointid.arm_side.fit import ArmSideFit
from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.elasticity import AGREEING, ElasticityFit
from jointid.estimation.estimators.parameters import EFFECTS, GEAR_LAWS
from jointid.estimation.quantities import Quantity, quantities
from jointid.wording import (
    capitalised,
    decimal_place,
    enumerated,
    joints_text,
    listed,
    percent,
    signed_percent,
    significant,
    with_error,
)

_PER_CENT = (0.67, 1.5)
"""Ratios of stiffnesses between which the difference is given in per cent."""
_AGREEMENT = 0.01
"""Stiffnesses that differ by at most 1 % count as equal: the path error is then below 0.1 mm."""

UNSTATED_TORQUE_SCALE = (
    "The torque scale is not stated: K, D and the inertias hold if the torque constants are exact. If "
    "they are known to 2 %, set std = 0.02 under [torque] in study.toml or in the inertia file."
)
ERROR_BARS = (
    "± is one standard error from noise, inertias, choice of model and, if stated, torque constants."
)
_ELSEWHERE = ("K", "D", "curve", "M", "M2", "torque_scale")
"""Quantities with tables of their own, and the friction curve: its coefficients mean nothing alone."""


@dataclass(frozen=True, eq=False)
class StiffnessUnit:
    """Unit and side of the gear for which K and D are shown; D is per rad always."""

    angle: str = "rad"
    gear_ratio: Floats | None = None
    """Motor turns per joint turn, shape (n,), for N² K and N² D at the joint; None: at the motor."""

    @classmethod
    def named(cls, name: str, gear_ratio: Floats | None = None) -> StiffnessUnit:
        """Return the unit of a name in ``STIFFNESS_UNITS``.

        Raises JointIdError when the name is another, or the joint's side needs gear ratios that are not
        given.
        """
        if name not in STIFFNESS_UNITS:
            raise JointIdError(f'The unit "{name:.60}" is not known. Units: {listed(STIFFNESS_UNITS)}.')
        side, angle = STIFFNESS_UNITS[name]
        if side == "motor":
            return cls(angle)
        if gear_ratio is None:
            raise JointIdError(
                f'"{name}" needs the gear ratios: state gear_ratio (motor turns per joint turn) in '
                "study.toml."
            )
        return cls(angle, gear_ratio)

    @property
    def is_default(self) -> bool:
        """Whether K is in N·m/rad at the motor."""
        return self.angle == "rad" and self.gear_ratio is None

    @property
    def side(self) -> str:
        """Side of the gear at which K and D are given."""
        return "seen from the motor" if self.gear_ratio is None else "at the joint"

    def shown(self, estimate: ArrayLike) -> Floats:
        """Convert K1 ... Kn, D1 ... Dn or their errors, shape (2n,), from N·m/rad at the motor."""
        values = np.asarray(estimate, float)
        n = values.size // 2
        side = np.ones(n) if self.gear_ratio is None else self.gear_ratio**2
        return np.asarray(values * np.concatenate([side * _RADIANS[self.angle], side]))

    def of_gear(self, joint: int) -> GearScale:
        """Factors for the deflection and the torque of one gear, from 0."""
        ratio = 1.0 if self.gear_ratio is None else abs(float(self.gear_ratio[joint]))
        per_rad, angle = (1e3, "mrad") if self.angle == "rad" else (1 / _RADIANS[self.angle], self.angle)
        side = "motor side" if self.gear_ratio is None else "joint side"
        return GearScale(
            per_rad / ratio, ratio, ratio**2 * _RADIANS[self.angle], angle, f"N·m/{self.angle}", side
        )


class GearScale(NamedTuple):
    """Factors from values of a gear in SI units at the motor to those shown."""

    wind_up: float
    torque: float
    stiffness: float
    angle: str
    """Unit of the deflection."""
    unit: str
    """Unit of the stiffness."""
    side: str


_RADIANS = {"rad": 1.0, "arcmin": np.pi / 10800, "°": np.pi / 180}
STIFFNESS_UNITS = {
    f"N·m/{angle} at the {side}": (side, angle) for side in ("motor", "joint") for angle in _RADIANS
}
"""Side and angle of each choice, the default first."""
AT_MOTOR = StiffnessUnit()


def elasticity_quantities(fit: ElasticityFit, unit: StiffnessUnit = AT_MOTOR) -> tuple[Quantity, ...]:
    """K1 ... Kn and D1 ... Dn with the total standard error."""
    table = quantities(fit)
    values, errors = unit.shown(fit.estimate).tolist(), unit.shown(fit.standard_error).tolist()
    stiffness = [replace(q, unit=f"N·m/{unit.angle}") for q in table["K"]]
    found = (*stiffness, *table["D"])
    return tuple(replace(q, value=values[q.place], error=errors[q.place]) for q in found)


def further_quantities(fit: ElasticityFit) -> tuple[Quantity, ...]:
    """Friction, delay and effects that were fitted together with K and D."""
    table = quantities(fit).items()
    return tuple(quantity for kind, found in table if kind not in _ELSEWHERE for quantity in found)


def friction_note(fit: ElasticityFit) -> str:
    """Meaning of a negative viscous friction; empty without one."""
    negative = [found for found in quantities(fit).get("viscous", ()) if found.value < 0]
    if not negative:
        return ""
    joints = joints_text(found.joints[0] for found in negative)
    if all(found.value > -AGREEING * found.error for found in negative):
        return f"The negative viscous friction of {joints} is consistent with 0."
    return (
        f"The viscous friction of {joints} is negative: friction falls with speed "
        "(Stribeck effect), or the value includes another effect. It holds at the measured speeds only."
    )


def gear_terms(fit: ElasticityFit, joint: int, unit: StiffnessUnit = AT_MOTOR) -> dict[str, str]:
    """Terms of gear catalogues for one joint, from 0, with values and units."""
    gear, curve, scale = fit.gears[joint], fit.torsion_curves[joint], unit.of_gear(joint)

    own = (row for row in chain(*quantities(fit).values()) if row.joints == (joint + 1,))
    errors = {row.parameter: row.error for row in own}

    def fitted(law: str, value: float, factor: float) -> str:
        return with_error(factor * value, factor * errors.get(law, np.nan))

    def wind_up(rad: float, digits: int = 3) -> str:
        return f"{significant(scale.wind_up * rad, digits)} {scale.angle}"

    def torques(*Nm: float, digits: int = 3) -> str:
        return ", ".join(significant(scale.torque * value, digits) for value in Nm) + " N·m"

    def stiffnesses(*K: float) -> str:
        return ", ".join(significant(scale.stiffness * value, 3) for value in K) + f" {scale.unit}"

    largest = torques(gear.tried_Nm, digits=2) if gear.tried_Nm else "–"
    terms = {"Law": laws_text(gear.laws), "Largest torque in the records": largest}
    K, error = scale.stiffness * gear.K, scale.stiffness * float(fit.errors.K[joint])
    terms["K (tangent stiffness)"] = f"{with_error(K, error)} {scale.unit}"
    if gear.kind in ("hardening", "piecewise"):
        terms[f"Secant stiffness at {largest}"] = stiffnesses(gear.secant_K)
        edge = gear.tried_rad
        slope = float(np.diff(gear.torque([edge, 1.001 * edge]))[0]) / (0.001 * edge)
        terms[f"Tangent stiffness at {largest}"] = stiffnesses(slope)
    if gear.K2:
        terms["Catalogue K1, K2, K3"] = stiffnesses(gear.K, gear.K2, gear.K3)
        terms["Catalogue T1, T2"] = torques(gear.T1_Nm, gear.T2_Nm)
    if gear.backlash_rad:
        share = f"{percent(gear.backlash_share)} of the peak-to-peak deflection"
        play = fitted("backlash", gear.backlash_rad, scale.wind_up)
        terms["Backlash"] = f"{play} {scale.angle}, {share}"
    if gear.hysteresis_Nm:
        loss = fitted("hysteresis", gear.hysteresis_Nm, scale.torque)
        terms["Hysteresis (half loop height)"] = f"{loss} N·m"
    lost = gear.backlash_rad + 2 * gear.hysteresis_Nm / gear.K if gear.K > 0 else 0.0
    noise, found = curve.deflection_noise_rad, "not measured"
    if noise.size:
        found = f"not detected (deflection known to ± {wind_up(float(np.median(noise)), 1)})"
    terms["Lost motion"] = wind_up(lost) if lost else found
    return terms


def without_curve(fit: ElasticityFit) -> str:
    """Say which joints have no measured torsion curve, and why; empty if all have one."""
    joints = [j for j, c in enumerate(fit.torsion_curves, start=1) if not c.torque_Nm.size]
    if not joints:
        return ""
    return (
        f"No measured torsion curve of {joints_text(joints)}: it needs motion above the locked "
        "resonance. The line is the fitted law up to the largest torque."
    )


def laws_text(laws: Sequence[str]) -> str:
    """Laws of a gear, the dominant one first, with the words of the findings."""
    return " + ".join(law.replace("piecewise", "three slopes") for law in laws)


def gear_text(fit: ElasticityFit, joint: int, unit: StiffnessUnit = AT_MOTOR) -> str:
    """The terms of ``gear_terms`` as a line."""
    terms = gear_terms(fit, joint, unit).items()
    parts = [
        f"{name if name[0] == 'K' else name[0].lower() + name[1:]} {value}" for name, value in terms
    ]
    return f"Joint {joint + 1}: {'; '.join(parts)}"


def model_name(fit: ElasticityFit | ArmSideFit) -> str:
    """Return the fitted model: "elasticity", with " + friction", " + delay" and effects where fitted."""
    if isinstance(fit, ArmSideFit):
        return fit.model
    return " + ".join(["elasticity", *fitted_parts(fit)])


def without(fit: ElasticityFit) -> str:
    """Return "without friction and delay" or other effects that the fit removes; "" without any."""
    laws = {EFFECTS[law].name: "nonlinearity of the gears" for law in GEAR_LAWS}
    removed = list(dict.fromkeys(laws.get(part, part) for part in fitted_parts(fit)))
    if "torque_scale" in fit.parameters.layout:
        removed.append("torque scale error")
    return f"without {enumerated(removed)}" if removed else ""


def fitted_parts(fit: ElasticityFit) -> list[str]:
    """Names of the effects fitted in addition to K, D, inertias and torque scales."""
    fitted = [name for name in EFFECTS if name in fit.parameters.layout]
    if "coulomb" in fit.parameters.layout:  # it contains viscous friction
        fitted.remove("viscous")
    found = ["friction"] * (fit.friction is not None and "viscous" not in fitted)
    return [*found, *["delay"] * (fit.delay is not None), *(EFFECTS[name].name for name in fitted)]


def answer_sentence(
    found: Sequence[Quantity],
    nominal: Floats | None = None,
    *,
    torque_stated: bool = True,
    side: str = AT_MOTOR.side,
) -> str:
    """State the identified stiffnesses, relative to the nominal ones if these are given.

    ``found`` holds K1 ... Kn, and D1 ... Dn where they are identified; ``nominal`` the values in the
    controller at present, in the same units. ``torque_stated`` is whether the uncertainty of the torque
    scale is part of the errors. If not, the sentence says so.
    """
    stiffness = [q for q in found if q.parameter == "K"]
    known = [q for q in stiffness if AGREEING * q.error < q.value]
    unknown = [q.joints[0] for q in stiffness if q not in known]
    missing = [f"the stiffness of {joints_text(unknown)}"] if unknown else []
    if not known:
        return f"These records do not determine {missing[0]}: see the findings."
    condition = "" if torque_stated else ", if the torque scale is exact"
    missing += [q.name for q in found if q.parameter == "D" and np.isinf(q.error)]
    tail = f" These records do not determine {enumerated(missing)}." if missing else ""
    return f"{_stiffnesses(known, nominal, side, is_all=not unknown)}{condition}.{tail}"


def _stiffnesses(known: Sequence[Quantity], nominal: Floats | None, side: str, *, is_all: bool) -> str:
    numbers = [f"{q.joints[0]}" for q in known]
    if nominal is None:
        found = [q.shown for q in known]
        if len(known) > _FEW:
            values = enumerated([value for value, _ in found])
            which = f"1 to {len(known)}" if is_all else enumerated(numbers)
            return f"The stiffnesses of joints {which} are {values} {found[0][1]}, {side}"
        first, *others = (
            f"of joint {j} is {' '.join(shown)}" for j, shown in zip(numbers, found, strict=True)
        )
        return f"The stiffness {first}{''.join(f', and that {other}' for other in others)}, {side}"
    differences = {
        j: _difference(q, float(nominal[q.place])) for j, q in zip(numbers, known, strict=True)
    }
    texts = [kind.format(size) for kind, size, _ in differences.values()]
    if is_all and len(known) > 1 and len(set(texts)) == 1:
        return f"Every joint {texts[0]}"
    if len(known) > _FEW:
        return _grouped(differences, is_all=is_all)
    texts[1:] = [re.sub(" (than|as) nominal$", "", text) for text in texts[1:]]
    each = zip(numbers, texts, strict=True)
    return capitalised(enumerated([f"joint {j} {text}" for j, text in each]))


_FEW = 2
"""Joints that the answer states one by one; of more, it groups those with the same difference."""


def _grouped(differences: Mapping[str, tuple[str, str, float]], *, is_all: bool) -> str:
    """Joints with the same kind of difference together, with the range of its size."""
    groups: dict[str, dict[str, float]] = {}
    for j, (kind, _, size) in differences.items():
        groups.setdefault(kind, {})[j] = size
    parts = []
    for kind, sizes in groups.items():
        ends = [significant(end(sizes.values()), 2) for end in (min, max)]
        difference = kind.format(" to ".join(dict.fromkeys(ends)))
        text = f"joint {enumerated(list(sizes))} {difference}"
        if is_all and len(sizes) == len(differences):
            text = f"every joint {difference}"
        elif len(sizes) > 1:
            for one, many in (("joint ", "joints "), (" is ", " are "), (" has its ", " have their ")):
                text = text.replace(one, many, 1)
        parts.append(text)
    return capitalised("; ".join(parts))


def _difference(found: Quantity, nominal: float) -> tuple[str, str, float]:
    """Kind of the difference of a stiffness from the nominal one, its size in words, its size."""
    ratio, error = found.value / nominal, found.error / nominal
    if abs(ratio - 1) <= max(_AGREEMENT, AGREEING * error):
        return "has its nominal stiffness", "", 0.0
    if _PER_CENT[0] < ratio < _PER_CENT[1]:
        percent = 100 * abs(ratio - 1)
        kind = f"is {{}} % {'stiffer' if ratio > 1 else 'softer'} than nominal"
        return kind, _two_digits(percent, 100 * error), percent
    return "is {} times as stiff as nominal", _two_digits(ratio, error), ratio


def _two_digits(value: float, error: float) -> str:
    """The value with two digits where its error allows them, else with its error."""
    if error < 0.5 * 10.0 ** (decimal_place(value) - 1):
        return significant(value, 2)
    return with_error(value, error)


def change_from(value: float, error: float, reference: float) -> str:
    """Deviation from a nominal value in per cent, "agrees" within two standard errors.

    A value within two standard errors of zero, which agrees with nearly any reference, gives "–".
    """
    if reference <= 0 or not AGREEING * error < abs(value):
        return "–"
    ratio = value / reference - 1
    if abs(ratio) <= AGREEING * error / reference:
        return "agrees"
    return signed_percent(100 * ratio)
