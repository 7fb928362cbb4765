"""Plants, campaigns and deviations of real robots from the ideal model, for ``whole_error``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks.independent_robot import (
    MIDDLE_HZ,
    Array,
    Experiment,
    Robot,
    paper_motions,
    settling_s,
    steady_state,
)
from jointid import Inertia, SineRecord, Study

PAPER = Robot(
    M=[0.0025, 0.0010], M2=[[0.004104, 0.000395], [0.000395, 0.001889]], K=[43.0, 7.5], D=[0.10, 0.015]
)  # fmt: skip
MANUTEC = Robot(
    M=[0.0013, 0.0013], M2=[[0.002274, 0.003522], [0.003522, 0.007068]], K=[8.0, 58.0], D=[0.01, 0.04]
)  # fmt: skip
"""Strongly coupled: axes 2 and 3 of the Manutec r3 with a load."""


def random_robot(rng: np.random.Generator, n: int = 2) -> Robot:
    """A robot whose joints resonate between 6 and 18 Hz with motors locked, damped by 3 to 10 %."""
    while True:
        scale = 10 ** rng.uniform(-3, -2, n)
        coupling = np.eye(n) + np.tril(rng.uniform(-0.6, 0.6, (n, n)) / max(1, n - 1), -1)
        coupling = np.tril(coupling) + np.tril(coupling, -1).T
        M2 = coupling * np.sqrt(np.outer(scale, scale))
        corner = 2 * np.pi * rng.uniform(6, 18, n)
        K = scale * corner**2
        robot = Robot(
            M=scale * rng.uniform(0.3, 1.2, n), M2=M2, K=K, D=2 * rng.uniform(0.03, 0.10, n) * K / corner
        )
        if np.linalg.eigvalsh(coupling)[0] > 0.2 and _calm(robot):
            return robot


def _calm(robot: Robot) -> bool:
    """Whether the robot settles soon under its controller."""
    try:
        return settling_s(robot) < 4.0
    except ValueError:
        return False


def varied(robot: Robot, rng: np.random.Generator, spread: float = 0.2) -> Robot:
    """The same robot with its numbers changed at random by up to ``spread``."""
    while True:
        by = {
            name: getattr(robot, name) * rng.uniform(1 - spread, 1 + spread, robot.n) for name in "MKD"
        }
        own = np.sqrt(rng.uniform(1 - spread, 1 + spread, robot.n))
        other = replace(robot, M2=robot.M2 * np.outer(own, own), **by)
        if _calm(other):
            return other


def plant_of(run: int, rng: np.random.Generator) -> Robot:
    """Plant of a run: every fourth Manutec's, every fourth a random one, otherwise the paper's."""
    kind = run % 4
    if kind == 3:
        return random_robot(rng)
    return varied(MANUTEC if kind == 1 else PAPER, rng)


def band(robot: Robot, low: float = 0.3, high: float = 3.0, count: int = 18) -> Array:
    """Frequencies relative to the lowest resonance with motors locked, 10 Hz of the paper's robot."""
    return np.geomspace(low, high, count) * robot.locked_hz.min()


@dataclass(frozen=True, eq=False)
class Campaign:
    """A robot, its experiment, and the inertias that the study states."""

    robot: Robot
    experiment: Experiment
    M: Array
    M2: Array

    @property
    def answer(self) -> Array:
        """K and D, shape (2n,).

        K rises with the frequency where the loss factor is constant. It is that at the geometric mean
        frequency of the records, as the finding on structural damping says.
        """
        centre_hz = np.exp(np.log(self.experiment.frequency_hz).mean())
        rise = 2 / np.pi * self.robot.loss_factor * np.log(centre_hz / MIDDLE_HZ)
        return np.concatenate([self.robot.K * (1 + rise), self.robot.D])

    def study(self, records: list[SineRecord], **more: Any) -> Study:
        return Study(records, Inertia(self.M, self.M2), **more)


def wrong_inertia(
    robot: Robot, rng: np.random.Generator, std: float, *, uniform: bool = False
) -> tuple[Array, Array]:
    """M and M2 with independent relative errors, as the prior has them, or within ± ``std``."""
    rows, columns = np.tril_indices(robot.n)
    own = np.sqrt(np.diag(robot.M2))
    unit = np.maximum(np.abs(robot.M2), 0.1 * np.outer(own, own))[rows, columns]

    def draw(size: int) -> Array:
        return rng.uniform(-std, std, size) if uniform else std * rng.standard_normal(size)

    while True:
        M = robot.M * (1 + draw(robot.n))
        M2 = robot.M2.copy()
        M2[rows, columns] += unit * draw(rows.size)
        M2[columns, rows] = M2[rows, columns]
        scale = np.sqrt(np.abs(np.outer(np.diag(M2), np.diag(M2))))
        if M.min() > 0 and np.diag(M2).min() > 0 and np.linalg.eigvalsh(M2 / scale)[0] > 0.02:
            return M, M2


@dataclass(frozen=True, eq=False)
class Loads:
    """Amplitudes of the ideal robot over the records of a campaign, one per joint."""

    deflection: Array
    """Largest of the gear, rad."""
    torque: Array
    """Largest of the gear, N·m."""
    least: Array
    """Smallest of the motor's torque, N·m."""

    @classmethod
    def of(cls, robot: Robot, experiment: Experiment) -> Loads:
        _, tau, deflection = np.abs(steady_state(robot, experiment))
        largest = deflection.max(axis=0)
        return cls(largest, robot.K * largest, tau.min(axis=0))


Change = Callable[[Robot, Loads], dict[str, Any]]
"""Fields of the robot that differ from the ideal one."""


@dataclass(frozen=True)
class Case:
    """A kind of study; deviations from the ideal model are relative to the robot and its motions."""

    title: str = ""
    change: Change = lambda robot, loads: {}
    joints: int = 2
    band: tuple[float, float, int] = (0.3, 3.0, 18)
    """Lowest and highest frequency over the lowest resonance with motors locked, and how many."""
    motions: Mapping[str, Any] = field(default_factory=dict)
    """Arguments of ``paper_motions``."""
    low_M2: float = 0.0
    """Relative error of the given M2, in place of random errors of all inertias."""

    def campaign(self, run: int, *, inertia_error: float = 0.02, noise: float | None = None) -> Campaign:
        """Campaign of a run; its plant, noise and inertia errors follow from the number.

        The inertias are known within normal errors, of less than the default prior's 5 %; noise is drawn
        between 0.1 and 3 % when it is None.
        """
        rng = np.random.default_rng([run, 12])
        robot = plant_of(run, rng) if self.joints == 2 else random_robot(rng, self.joints)
        level = 10 ** rng.uniform(-3, np.log10(0.03))
        experiment = paper_motions(
            robot,
            band(robot, *self.band),
            seed=run,
            per_frequency=max(self.joints, 2),
            noise=level if noise is None else noise,
            **self.motions,
        )
        M, M2 = wrong_inertia(robot, rng, inertia_error)
        if self.low_M2:
            M, M2 = robot.M, robot.M2 * (1 + self.low_M2)
        robot = replace(robot, **self.change(robot, Loads.of(robot, experiment)))
        return Campaign(robot, experiment, M, M2)


LOW = (0.2, 0.6, 9)
"""2 to 6 Hz on the paper's robot."""


def _hardening(share: float) -> Change:
    return lambda robot, loads: {"cubic": share * robot.K / loads.deflection**2}


def _link(times: float) -> Change:
    return lambda robot, _: {"link_share": link_share(robot), "link_hz": times * free_hz(robot)}


def link_share(robot: Robot) -> float:
    """20 % of the arm behind the link, less where a strong coupling leaves too little for the rest."""
    own = np.sqrt(np.diag(robot.M2))
    return float(min(0.2, 0.5 * np.linalg.eigvalsh(robot.M2 / np.outer(own, own))[0]))


def free_hz(robot: Robot) -> Array:
    """Resonance of each joint on its own with the motor free, Hz."""
    return np.sqrt(robot.K * (1 / robot.M + 1 / np.diag(robot.M2))) / (2 * np.pi)


THIRTEEN = {
    "1": Case(
        "hysteresis (Dahl) of 2 % of the peak torque",
        lambda _, loads: {
            "hysteresis_Nm": 0.02 * loads.torque, "hysteresis_rad": 0.02 * loads.deflection
        },
    ),
    "2": Case(
        "Coulomb friction at the arm, 0.4 % of the peak torque",
        lambda _, loads: {"arm_coulomb": 0.004 * loads.torque},
    ),
    "3": Case("viscous friction at the arm, 2 % of D", lambda robot, _: {"arm_viscous": 0.02 * robot.D}),
    "4": Case(
        "viscous friction at the arm, 2 % of D, 2–6 Hz",
        lambda robot, _: {"arm_viscous": 0.02 * robot.D},
        band=LOW,
    ),
    "5": Case("lag of 0.1 ms in one joint, 2–6 Hz", lambda *_: {"lag_s": [1e-4, 0.0]}, band=LOW),
    "6": Case("hardening of 50 % at the peak deflection", _hardening(0.5)),
    "7": Case("hardening of 20 %", _hardening(0.2)),
    "8": Case("hardening of 5 %, two amplitudes", _hardening(0.05), motions={"levels": (1.0, 0.5)}),
    "9": Case("link modes at 6 times the joint's", _link(6)),
    "10": Case("link modes at 12 times", _link(12)),
    "11": Case(
        "backlash of 0.3 % of the deflection",
        lambda _, loads: {"backlash_rad": 0.003 * 2 * loads.deflection},
    ),
    "12": Case("M2 1 % low", low_M2=-0.01),
    "13": Case("position filter of 100 Hz, 2–6 Hz", lambda *_: {"position_filter_hz": 100.0}, band=LOW),
}  # fmt: skip
"""The cases of the physics notes in which a linear fit was wrong without any warning."""


def _ripple(share: float, per_turn: int) -> Change:
    """Torque ripple over the largest torque of the gear, beside a little friction."""

    def change(_: Robot, loads: Loads) -> dict[str, Any]:
        size = {"ripple_Nm": share * loads.torque, "per_turn": per_turn, "phase": [0.7, 2.1]}
        return {**size, "coulomb": 0.1 * loads.least}

    return change


def _transmission(share: float) -> Change:
    """Transmission error over the largest deflection, twice per turn."""
    return lambda _, loads: {
        "transmission_rad": share * loads.deflection, "per_turn": 2, "phase": [0.7, 2.1]
    }  # fmt: skip


OTHERS = {
    "structural damping, loss factor 0.02": Case(change=lambda *_: {"loss_factor": 0.02}),
    "gravity stiffness, 3 % of K": Case(change=lambda robot, _: {"gravity": 0.03 * robot.K}),
    "torque filter of 100 Hz": Case(change=lambda *_: {"torque_filter_hz": 100.0}),
    "lag of 0.5 ms in one joint": Case(change=lambda *_: {"lag_s": [5e-4, 0.0]}),
    "reversed axis": Case(change=lambda *_: {"reversed": [1.0, -1.0]}),
    "swapped joints": Case(change=lambda *_: {"swapped": True}),
    "link modes at 3 times the joint's": Case(change=_link(3)),
    "backlash of 3 % of the deflection": Case(
        change=lambda _, loads: {"backlash_rad": 0.03 * 2 * loads.deflection}
    ),
    "torque ripple of 1 %, 6 per turn": Case(change=_ripple(0.01, 6)),
    "torque ripple of 3 %, 24 per turn": Case(change=_ripple(0.03, 24)),
    "transmission error of 5 % of the deflection": Case(change=_transmission(0.05)),
}
"""More deviations, tried in the same way."""


def rubbing(share: float, **more: float) -> Change:
    """Coulomb friction over the smallest motor torque; further levels are given over that friction."""

    def change(_: Robot, loads: Loads) -> dict[str, Any]:
        level = share * loads.least
        levels = {name: level * more[name] for name in ("stribeck", "viscous") if name in more}
        return {"coulomb": level, **more, **levels}

    return change


PERFECT = {
    "10.5 periods": Case(),
    "5 periods": Case(motions={"periods": 5}),
    "2–6 Hz": Case(band=LOW),
    "5–25 Hz": Case(band=(0.5, 2.5, 12)),
    "one joint": Case(joints=1),
    "six joints, 42 records": Case(joints=6, band=(0.3, 3.0, 7)),
    "mild friction": Case(change=rubbing(0.1, viscous=0.04)),
}
"""Studies that fit the model."""

STICKING = {
    "Coulomb": Case(change=rubbing(0.5, viscous=0.04)),
    "Coulomb, 80 %": Case(change=rubbing(0.8, viscous=0.04)),
    "smoothed below 0.05 rad/s": Case(change=rubbing(0.5, smoothing_rad_s=0.05)),
    "Stribeck": Case(change=rubbing(0.4, stribeck=0.4, stribeck_rad_s=0.3)),
    "asymmetric": Case(change=rubbing(0.5, asymmetry=0.2)),
    "load-dependent": Case(change=rubbing(0.4, load=0.1)),
    "presliding (Dahl)": Case(change=rubbing(0.5, presliding_rad=1e-3)),
    "presliding (LuGre)": Case(
        change=rubbing(0.4, stribeck=0.3, presliding_rad=1e-3, bristle_damping=0.2)
    ),
}
"""Friction of half the smallest torque amplitude and more: joints stick at their reversals."""


def together(*changes: Change) -> Change:
    """Several deviations at once."""

    def change(robot: Robot, loads: Loads) -> dict[str, Any]:
        return {name: value for each in changes for name, value in each(robot, loads).items()}

    return change


def _hysteresis(share: float) -> Change:
    """Dahl's, over the peak torque."""
    return lambda _, loads: {
        "hysteresis_Nm": share * loads.torque, "hysteresis_rad": 0.02 * loads.deflection
    }  # fmt: skip


def _gravity(share: float) -> Change:
    return lambda robot, _: {"gravity": share * robot.K}


def _slopes(_: Robot, loads: Loads) -> dict[str, Any]:
    first, second = {"knee_slope": 1.3}, {"second_slope": 1.7}
    first |= {"knee_rad": 0.4 * loads.deflection}
    return first | second | {"second_knee_rad": 0.75 * loads.deflection}


def _backlash(share: float) -> Change:
    return lambda _, loads: {"backlash_rad": share * 2 * loads.deflection}


def _arm_friction(share: float) -> Change:
    return lambda _, loads: {"arm_coulomb": share * loads.torque}


def _filters(*_: object) -> dict[str, Any]:
    return {"position_filter_hz": 100.0, "torque_filter_hz": 150.0}


_TWO = {"levels": (1.0, 0.5)}
_RUBS, _RUBS_LITTLE = rubbing(0.3, viscous=0.04), rubbing(0.2, viscous=0.04)
COMBINED = {
    "gravity, friction": Case(change=together(_gravity(0.05), _RUBS)),
    "gravity, soft links": Case(change=together(_gravity(0.05), _link(5))),
    "gravity, hardening, friction": Case(change=together(_gravity(0.05), _hardening(0.3), _RUBS)),
    "gravity, hysteresis, friction": Case(
        change=together(_gravity(0.05), _hysteresis(0.04), _RUBS_LITTLE)
    ),
    "hardening, friction": Case(change=together(_hardening(0.3), _RUBS)),
    "hardening, hysteresis, friction, two amplitudes": Case(
        change=together(_hardening(0.3), _hysteresis(0.03), _RUBS_LITTLE), motions=_TWO
    ),
    "hardening, presliding friction": Case(
        change=together(_hardening(0.3), rubbing(0.4, presliding_rad=1e-3))
    ),
    "hardening, soft links": Case(change=together(_hardening(0.2), _link(4))),
    "three slopes, friction, two amplitudes": Case(change=together(_slopes, _RUBS_LITTLE), motions=_TWO),
    "backlash, friction": Case(change=together(_backlash(0.03), _RUBS)),
    "backlash, hardening, two amplitudes": Case(
        change=together(_backlash(0.03), _hardening(0.3)), motions=_TWO
    ),
    "hysteresis, friction": Case(change=together(_hysteresis(0.05), _RUBS)),
    "hysteresis, friction at the arm": Case(change=together(_hysteresis(0.03), _arm_friction(0.01))),
    "friction at arm and motor": Case(change=together(_arm_friction(0.01), _RUBS)),
    "soft links, friction": Case(change=together(_link(4), _RUBS)),
    "filters of position and torque, friction": Case(change=together(_filters, _RUBS)),
    "torque ripple, friction": Case(change=together(_ripple(0.02, 12), rubbing(0.4, viscous=0.04))),
    "transmission error, friction": Case(change=together(_transmission(0.05), _RUBS_LITTLE)),
}
"""Several deviations at once, as real robots have them."""
