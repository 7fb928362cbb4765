"""Meaning of column names, in several languages."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass

from jointid.importing.columns.log_table import LogColumn
from jointid.importing.columns.units import QUANTITIES

_LINES = {  # English, German, French, Italian, Spanish; without accents
    "time": "time t zeit zeitstempel timestamp timestamps stamp clock temps tempo tiempo uhrzeit "
    "zeitpunkt abtastzeit sec secs nsec elapsed messzeit",
    "sample": "sample samples index idx nr no takt cycle zyklus step schritt ipoc counter",
    "position": "position positions pos angle angles ang theta th q phi winkel lage lagen ist istwert "
    "istposition istwinkel istlage lageistwert motorwinkel gelenkwinkel achswinkel drehwinkel "
    "encoder enc inc ink inkr inkremente increments drehgeber geber resolver axis achse joint "
    "gelenk posizione angolo posicion angulo angulaire actpos poscurr axispos measured actual "
    "act fbk feedback",
    "torque": "torque torques trq tau tq mom mmt moment momente eff gelenkmoment lastmoment drehmoment "
    "motormoment istmoment effort efforts couple coppia par moteur load last current curr strom "
    "motorstrom iq i amp courant corrente corriente torcurr axistorque acttorque",
    "velocity": "velocity velocities vel speed speeds dq qd qdot omega w drehzahl geschwindigkeit "
    "geschw vitesse velocita velocidad rate rpm dot acceleration acc accel beschleunigung qdd jerk",
    "command": "command cmd commanded soll sollwert sollposition sollmoment sollwinkel reference ref "
    "desired des target ziel setpoint setp consigne stell vorgabe planned nominal error err fehler "
    "deviation abweichung schleppfehler deflection feedforward ff vorsteuerung",
    "other": "temperature temp temperatur voltage spannung volt power leistung status state mode error "
    "flag digital input output force kraft pressure druck busvoltage pwm",
    "motor": "motor motorside mot rotor antrieb antriebsseitig motorseitig motormoment motorwinkel "
    "moteur motore drive",
    "joint": "joint link arm load abtrieb output achse axis gelenk axe asse eje abtriebsseitig "
    "lastseitig",
    "behind": "joint link linkside jointside arm armside loadside output abtrieb abtriebsseitig gelenk "
    "gelenkmoment gelenkwinkel lastseitig",
    "any": "joint axis achse gelenk ist act actual measured fbk feedback load last th",
    "current": "current curr strom motorstrom iq i amp courant corrente corriente",
}
WORDS = {kind: set(line.split()) for kind, line in _LINES.items()}
_ALL_WORDS = set().union(*WORDS.values())
_TOKEN = re.compile(r"[a-z]+|\d+")


@dataclass(frozen=True, eq=False)
class NamedColumn:
    """A column and the meaning of its name."""

    column: LogColumn
    group: str
    """Identifier of the joint: the name without the words for quantities."""
    score: dict[str, float]
    """Evidence for "position" and for "torque"; negative values are evidence against."""


def described(column: LogColumn) -> NamedColumn:
    """Score a column as position and as torque from its name and unit, and identify its joint."""
    words = words_of(column.name)
    stated = set(words)
    score = {}
    for role, (units, _) in QUANTITIES.items():
        points = 0.0
        if named := stated & WORDS[role]:
            # "joint", "axis" and "ist" go with any quantity.
            points += 0.8 if named <= WORDS["any"] else 2.0
        if column.unit in units and column.unit != "V":
            points += 2.0
        elif column.unit == "V":
            points += 0.2
        elif column.unit:
            points -= 4.0
        if stated & WORDS["current"] and role == "torque":
            points -= 0.5
        for kind, cost in (("velocity", 3.0), ("command", 1.5), ("other", 1.0), ("time", 1.0)):
            points -= cost * bool(stated & WORDS[kind] - WORDS[role])
        points -= 0.25 * bool("motor" in stated and role == "position")
        score[role] = points
    # Without the words for quantities, the rest of the name identifies the joint.
    left = [w for w in words if w.isdigit() or w not in _ALL_WORDS]
    return NamedColumn(column, " ".join(left).lstrip("0") or " ".join(left), score)


def words_of(name: str) -> tuple[str, ...]:
    """Lower-case words and numbers of a name: "ActPos_A1" is act, pos, a, 1."""
    plain = unicodedata.normalize("NFKD", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name))
    plain = "".join(c for c in plain if not unicodedata.combining(c)).lower()
    for letter, word in (("θ", "theta"), ("τ", "tau"), ("φ", "phi"), ("ϑ", "theta"), ("ß", "ss")):
        plain = plain.replace(letter, word)
    return tuple(_TOKEN.findall(plain))


def number_in(group: str) -> int | None:
    """Return the last number in a joint's identifier, if there is one."""
    found = re.findall(r"\d+", group)
    return int(found[-1]) if found else None


def by_number(group: str) -> tuple[int, str]:
    """Sort key: "2" before "10"."""
    return (number_in(group) or 0, group)
