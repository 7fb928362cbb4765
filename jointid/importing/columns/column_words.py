"""Meaning of column names, in several languages."""

import re
import unicodedata
from collections.abc import Sequence, Set
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np

from jointid.arrays import Floats
from jointid.importing.columns.log_table import LogColumn
from jointid.importing.columns.units import ANGLE_UNITS, QUANTITIES, SAMPLES, TIME_UNITS

_LINES = {  # English, German, French, Italian, Spanish and others; without accents
    "time": "time t ts zeit zeitstempel timestamp stamp clock temps tempo tiempo tijd uhrzeit "
    "zeitpunkt abtastzeit sec secs nsec elapsed messzeit duration cas czas zaman tid",
    "sample": "sample index idx nr no takt cycle zyklus step schritt ipoc counter zaehler zahler",
    "position": "position pos angle ang theta th q phi winkel lage lagen ist istwert "
    "lageistwert drehwinkel encoder enc inc ink inkr inkremente increments drehgeber geber resolver "
    "axis achs achse joint jnt gelenk posizione angolo posicion angulo angulaire hoek poscurr "
    "measured actual act fbk fb feedback pulse xist posicao poloha uhel pozycja kat konum "
    "vinkel lastlage lastwinkel positie pozice",
    "torque": "torque torq trq tau tq mom mmt moment momente eff drehmoment "
    "effort couple coppia par koppel load last current curr cur strom stroom "
    "iq isq i amp courant corrente corriente intensite torcurr binario tork vridmoment proud prad",
    "velocity": "velocity velocities vel v speed dq qd qdot omega w drehzahl geschwindigkeit "
    "geschw vitesse velocita velocidad velocidade snelheid rate rpm dot acceleration acc accel "
    "beschleunigung qdd ddq jerk dtau dtheta rychlost otacky predkosc hiz hastighet hastighed",
    "command": "command cmd commanded demand input set soll sollwert reference ref "
    "desired des md target goal ziel setpoint setp consigne stell vorgabe planned nominal feedforward "
    "ff vorsteuerung d",
    "no": "disturbance stoermoment stormoment droop "
    "error err fehler deviation abweichung schleppfehler deflection limit min max offset bias "
    "temperature temp temperatur pressure druck status flag success id phase model gain kp ki kd "
    "constant inertia valid std stddev friction fric gravity grav coriolis brake tcp euler electrical "
    "commutation flux supply leakage battery batterie zwischenkreis",
    "volt": "voltage spannung tension volt busvoltage",
    "other": "power leistung state mode digital output force kraft "
    "pwm ext external hat filtered gefiltert estimate estimated",
    "motor": "motor motorside mot mtr rotor antrieb antriebsseitig motorseitig moteur motore drive",
    "joint": "joint jnt j link arm load abtrieb output achse axis gelenk axe asse eje abtriebsseitig "
    "lastseitig junta eixo osa osy osi eksen axel",
    "behind": "joint link linkside jointside arm armside loadside output abtrieb abtriebsseitig gelenk "
    "lastseitig",
    "link": "link linkside arm armside load loadside lastlage lastwinkel lastseitig abtrieb "
    "abtriebsseitig secondary",
    "any": "joint jnt axis achs achse gelenk ist istwert act actual measured fbk fb feedback load "
    "last th",
    "path": "axes drive value main plc prg gvl robot channel state inputs outputs "
    "controller control actuator encoder foc ictrl pctrl meas",
    "current": "current curr cur strom stroom iq isq i amp courant corrente corriente intensite proud "
    "prad",
}
WORDS = {kind: set(line.split()) for kind, line in _LINES.items()}
_ALL_WORDS = set().union(*WORDS.values())
_TOKEN = re.compile(r"[a-z]+|\d+")
_SOFT = WORDS["any"] | WORDS["current"]
_ELECTRIC = WORDS["current"] | WORDS["volt"]
_QUANTITY = set().union(*(WORDS[k] for k in ("time", "position", "torque", "velocity"))) - WORDS["any"]
_COSTS = tuple(
    {"velocity": 4.0, "command": 1.5, "no": 4.0, "volt": 4.0, "other": 1.0, "sample": 1.5}.items()
)
"""Evidence against a position and a torque."""
_NOT_MEASURED = WORDS["command"] - {"d", "ff"} | {"error", "err", "deviation", "fehler"}
"""Words of a whole path: "state/desired/positions" is no motion."""
_COMPONENT = re.compile(
    rf"\b(?:{'|'.join(sorted((WORDS['position'] | WORDS['torque']) - _SOFT - WORDS['joint']))}) [xyz]$"
)
"""Coordinates after a quantity: "pos_x", "torque_z"; axes of a machine stand before it."""
_SUPPLY = re.compile(
    rf"\bdc (?:link|bus|rail)\b|\b(?:bus|grid) (?:{'|'.join(sorted(_ELECTRIC))})\b|\b[uvi] (?:dc|bus)\b"
)
"""Electrical supply of a drive: "dcLinkCurrent", "bus voltage", "i_dc"; a bus may be one of data."""
_COUNTED = WORDS["joint"] | WORDS["motor"] | {"axes", "servo", "a", "q"} - {"arm", "load", "output"}
"""Words before the number of a joint."""

# CiA 402 (IEC 61800-7-201): objects of the drive profile; those of axis k begin at 6000h + 800h (k - 1).
_OBJECTS = {
    0x6063: "position actual", 0x6064: "position actual", 0x6077: "torque actual",
    0x6078: "current actual", 0x606C: "velocity actual", 0x6069: "velocity actual",
    0x6062: "position demand command", 0x606B: "velocity demand", 0x6074: "torque demand command",
    0x607A: "position target", 0x6071: "torque target", 0x60FF: "velocity target",
    0x60F4: "position error", 0x6079: "voltage", 0x6040: "status", 0x6041: "status",
}  # fmt: skip
_OBJECT = re.compile(
    r"(?<![0-9a-z])(?:0x(6[0-9a-f]{3})|(6[0-9a-f]{3})h|(6[0-9a-f]{3})(?=:))(?![0-9a-z])"
)


RATED_SHARE = re.compile(r"(?i)\b(?:torque|current)[ _]?actual[ _]?value")
"""Names of the objects 6077h and 6078h of CiA 402, in thousandths of the rated value as INT16."""


_PARAMETER = re.compile(
    r"(?<![A-Za-z0-9])(?:[rp]\d{1,5}(?:\[\d+\])?(?=:)|[SP]-\d-\d{4}|[1-9]\d{3}(?= [A-Za-z])|ID(?=\d))"
)
"""Numbers of parameters and signals, not of joints: "r61:", "S-0-0051", "1718 Motor position"; "ID1"."""
_ALIASES = {
    "aipos": "axis actual pos", "aspos": "axis target pos", "macur": "motor current",
    "fpos": "actual pos", "rpos": "target pos", "qpos": "pos", "qvel": "vel", "qfrc": "torque",
    "pl": "pos", "il": "current", "vl": "vel", "tqd": "tqd velocity",
    "mp": "measured pos", "mt": "measured torque",
    "dclink": "dc link", "dcbus": "dc bus", "vdc": "v dc", "udc": "u dc", "idc": "i dc",
    "vbus": "v bus", "ibus": "i bus",
    "qm": "motor q", "ql": "link q", "thetam": "motor theta", "taum": "motor tau",
}  # fmt: skip
"""Signals of KUKA's interfaces, ACS' controllers, MuJoCo and Kollmorgen; supplies; symbols of papers."""


_LETTERS = {"θ": "theta", "τ": "tau", "φ": "phi", "ϑ": "theta", "ß": "ss"}
_SCRIPTS = {  # Japanese, Chinese, Korean, Russian
    word: f" {meaning} "
    for meaning, line in {
        "time": "時間 時刻 时间 시간 время",
        "angle": "角度 位置 각도 위치 угол положение",
        "velocity": "速度 속도 скорость",
        "torque": "トルク 力矩 扭矩 转矩 토크 момент",
        "current": "電流 电流 전류 ток",
        "command": "指令 目標 目标 设定 지령 задани",
        "error": "偏差 誤差 误差 오차 ошибка",
        "temperature": "温度 온도 температура",
        "voltage": "電圧 电压 전압 напряжение",
        "joint": "関節 关节 軸 轴 관절 ось",
        "motor": "モータ 电机 모터 двигател",
        "load": "負荷 负载 부하",
    }.items()
    for word in line.split()
}


@dataclass(frozen=True, eq=False)
class NamedColumn:
    """A column and the meaning of its name."""

    column: LogColumn
    group: str
    """Identifier of the joint: the name without the words for quantities."""
    number: int | None
    """Number of the joint: after a word for a joint, else the last; None without one."""
    score: dict[str, float]
    """Evidence for "position" and for "torque"; negative values are evidence against."""


def all_described(columns: Sequence[LogColumn]) -> list[NamedColumn]:
    """Score the columns of a log; with tqd, the target of a velocity, tq is the target of q."""
    targets = any("tqd" in words_of(column.name) for column in columns)
    return [described(column, {"tq"} if targets else set()) for column in columns]


def described(column: LogColumn, targets: Set[str] = frozenset()) -> NamedColumn:
    """Score a column as position and as torque from its name and unit, and identify its joint."""
    words = words_of(column.name)
    stated = _of_quantity(column.name) | _NOT_MEASURED & set(words)
    if _SUPPLY.search(" ".join(words)):
        stated = stated | {"supply"}
    if stated & targets:
        stated = stated - targets | {"target", "q"}
    current = stated & WORDS["current"]
    if current and stated & WORDS["position"] - WORDS["any"] <= {"q"}:
        stated = stated - {"q"}  # the q axis of the motor, not an angle
    axes = {a for a, b in pairwise(words) if a in ("v", "w") and b.isdigit()}
    stated -= axes if stated & _QUANTITY - axes else set()  # "w0 angle" is that of a joint w0
    score = {}
    for role, (units, _) in QUANTITIES.items():
        points = 0.0
        if named := stated & WORDS[role]:
            # "joint", "axis" and "ist" go with any quantity: an unknown word behind them may be one.
            points += 2.0 if named - WORDS["any"] else 0.8 * (not _unknown_after(words, named))
        if column.unit in units and column.unit != "V":
            points += 2.0
        elif column.unit == "V":
            points += 0.2
        elif column.unit:
            points -= 4.0
        if role == "torque":  # a load torque may be an estimate of what the current does not explain
            points -= 0.5 * bool(current) + 0.6 * ("load" in words)
            points -= 3.0 * bool(stated & {"ext", "external"})  # an encoder may be external
        for kind, cost in _COSTS:
            points -= cost * bool(stated & WORDS[kind] - WORDS[role])
        if clock := stated & WORDS["time"]:
            points -= 1.0 if clock <= {"t"} else 4.0
        if role == "position":
            points -= 2.5 * bool(stated & WORDS["command"])  # a torque's command is nearly the torque
            points += 0.25 * bool("motor" in words)
        score[role] = points
    if _COMPONENT.search(" ".join(words)) and column.unit not in ANGLE_UNITS:
        score = dict.fromkeys(score, -4.0)  # of a point or a wrench in space
    if stated & WORDS["torque"] - _SOFT:
        score["position"] -= 4.0  # "q7_tau" is the torque of a joint
    elif score["position"] == score["torque"]:
        score = dict.fromkeys(score, min(0.0, score["torque"]))
    # Without the words for quantities, the rest of the name identifies the joint.
    left = [w for w in words if w.isdigit() or w not in _ALL_WORDS]
    digits = [int(w) for w in words if w.isdigit()]
    counted = [int(b) for a, b in pairwise(words) if a in _COUNTED and b.isdigit()]
    number = next(iter([*counted, *digits[-1:]]), None)
    return NamedColumn(column, re.sub(r"^0+(?=\d)", "", " ".join(left)), number, score)


def _unknown_after(words: tuple[str, ...], named: Set[str]) -> bool:
    """Whether an unknown word follows the first of some words: "seq" of "axis 1 seq"."""
    at = min(words.index(word) for word in named)
    return any(len(w) > 2 and not w.isdigit() and w not in _ALL_WORDS for w in words[at:])


def _of_quantity(name: str) -> set[str]:
    """Words of the last part of a path that names a quantity: pos, rel of "pos_vel_mapper.pos_rel"."""
    parts = [set(words_of(part)) for part in re.split(r"[./\\|]+", name)]
    if parts[-1] in ({"d"}, {"q"}) and len(parts) > 1 and parts[-2] & _ELECTRIC:
        parts[-2:] = [parts[-2] | parts[-1]]  # axes of the motor's field: "current.q", "voltage.d"
    return next((part for part in reversed(parts) if part & _QUANTITY), set().union(*parts))


def states_quantity(column: LogColumn) -> bool:
    """Whether name or unit say that a column is neither a clock nor a counter."""
    stated = _of_quantity(column.name)
    if stated & WORDS["time"] or stated & WORDS["sample"]:
        return False
    return bool(stated & _QUANTITY) or column.unit not in ("", SAMPLES, *TIME_UNITS)


def drive_object(name: str) -> str:
    """Words for the CiA 402 object that a name states, "torque actual" for "6077h", or ""."""
    found = _OBJECT.search(name.lower())
    words = _object_words(found).strip() if found else ""
    return words if found and words != found[0] else ""


def in_thousandths(name: str, values: Floats) -> bool:
    """Whether whole numbers have a name that CiA 402 gives to thousandths of a rated value."""
    finite = values[np.isfinite(values)]
    whole = bool(np.any(finite)) and bool(np.all(finite == np.round(finite)))
    return whole and RATED_SHARE.search(name) is not None


def words_of(name: str) -> tuple[str, ...]:
    """Lower-case words and numbers of a name: "ActPos_A1" is act, pos, a, 1."""
    name = _PARAMETER.sub(" ", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name))
    if drive_object(name):
        name = _OBJECT.sub(_object_words, name.lower())
    plain = re.sub(r"\b[iI]_?[qQ](?![a-z])", "iq", name).lower()
    for sign, word in (_LETTERS | _SCRIPTS).items():
        plain = plain.replace(sign, word)
    plain = "".join(c for c in unicodedata.normalize("NFKD", plain) if not unicodedata.combining(c))
    return tuple(
        word
        for token in _TOKEN.findall(plain)
        for part in _ALIASES.get(token, token).split()
        for word in _parts(part)
    )


@cache
def _parts(word: str) -> tuple[str, ...]:
    """A word without a plural s, or the two of a compound: position, istwert of "positionsistwert"."""
    if len(word) > 3 and word not in _ALL_WORDS and word.removesuffix("s") in _ALL_WORDS:
        return (word.removesuffix("s"),)
    cuts = range(3, len(word) - 2) if word not in _ALL_WORDS else ()
    both = ((first, word[k:]) for k in cuts for first in (word[:k], word[:k].removesuffix("s")))
    return next((pair for pair in both if _ALL_WORDS.issuperset(pair)), (word,))


def in_other_script(text: str) -> bool:
    """Whether a text holds a word for a quantity in Japanese, Chinese, Korean or Russian."""
    return any(word in text for word in _SCRIPTS if len(word) > 1)


def _object_words(found: re.Match[str]) -> str:
    code = int(next(filter(None, found.groups())), 16)
    axis = (code - 0x6000) // 0x800
    words = _OBJECTS.get(code - axis * 0x800, "")
    return f"{words} {axis + 1 if axis else ''} " if words else found[0]
