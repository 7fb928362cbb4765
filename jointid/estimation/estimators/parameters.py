"""Named blocks of the parameter vector: stiffness, damping, friction, effects, inertias.

``PARAMETERS`` is the one table of their names and units.

The effects are deviations of real robots from equation (1), each of one or two numbers per joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, pairwise
from math import prod
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from jointid.arrays import Floats
from jointid.joints import arm_inertia


@dataclass(frozen=True)
class Effect:
    """One effect; its first parameter is zero on an ideal robot."""

    name: str
    """Name in the description of a model and in the verdict."""
    parameters: dict[str, tuple[str, str]]
    """Label, without the joint's number, and unit of each block of parameters."""
    positive: bool = False
    """Whether the first parameter cannot be negative, such as a friction, damping or mass."""


def _of_change(of: str) -> dict[str, tuple[str, str]]:
    parts = zip(("", "_2", "_3"), ("", ", quadratic", ", cubic"), strict=True)
    return {f"{of}_change{k}": (f"relative {of} change{part}", "") for k, part in parts}


EFFECTS = {
    "viscous": Effect(
        "viscous motor friction", {"viscous": ("viscous friction", "N·m·s/rad")}, positive=True
    ),
    "arm_viscous": Effect(
        "arm-side viscous friction",
        {"arm_viscous": ("arm-side viscous friction", "N·m·s/rad")},
        positive=True,
    ),
    "arm_coulomb": Effect(
        "arm-side Coulomb friction", {"arm_coulomb": ("arm-side Coulomb friction", "N·m")}, positive=True
    ),
    "loss_factor": Effect("structural damping", {"loss_factor": ("loss factor", "")}, positive=True),
    "stiffness_change": Effect("changing stiffness", _of_change("stiffness")),
    "damping_change": Effect("changing damping", _of_change("damping")),
    "lag": Effect("a lag per joint", {"lag": ("lag", "s")}),
    "position_filter": Effect("a position filter", {"position_filter": ("position filter", "s")}),
    "torque_filter": Effect("a torque filter", {"torque_filter": ("torque filter", "s")}),
    "load": Effect(
        "load-dependent friction", {"load": ("load-dependent friction coefficient", "")}, positive=True
    ),
    "motor_presliding": Effect(
        "presliding friction",
        {"motor_presliding": ("presliding friction", "N·m"), "bristle": ("presliding angle", "rad")},
        positive=True,
    ),
    "ripple": Effect(
        "torque ripple",
        {
            "ripple": ("torque ripple", "N·m"),
            "ripple_quadrature": ("torque ripple in quadrature", "N·m"),
        },
    ),
    "transmission": Effect(
        "transmission error",
        {
            "transmission": ("transmission error", "rad"),
            "transmission_quadrature": ("transmission error in quadrature", "rad"),
        },
    ),
    "link": Effect("link flexibility", {"link": ("link flexibility", "kg·m²·s²")}, positive=True),
    "gravity": Effect("gravity stiffness", {"gravity": ("gravity stiffness", "N·m/rad")}),
    "cubic": Effect("a hardening gear", {"cubic": ("cubic stiffness", "N·m/rad³")}),
    "piecewise": Effect(
        "a gear with three slopes",
        {
            "piecewise": ("change of slope at T1", "N·m/rad"),
            "knee": ("deflection at T1", "rad"),
            "second_bend": ("change of slope at T2", "N·m/rad"),
            "second_knee": ("deflection from T1 to T2", "rad"),
        },
    ),
    "backlash": Effect("backlash", {"backlash": ("backlash", "rad")}, positive=True),
    "hysteresis": Effect(
        "gear hysteresis",
        {"hysteresis": ("hysteresis", "N·m"), "presliding": ("presliding deflection", "rad")},
        positive=True,
    ),
}
"""By key. With s = iω, ``viscous`` v, without Coulomb friction, adds sv to a motor's dynamic stiffness,
which friction contains; ``arm_viscous`` v and ``gravity`` G add sv + G to the arm's dynamic stiffness,
and ``link`` c adds −s⁴c (the first term of a mode above the band, c = J_link/ω_link²); ``loss_factor``
η adds iηK, and the stiffness that comes with it, to the gear's; K and D change by ``stiffness_change``
and ``damping_change`` over the records. ``lag`` d multiplies a joint's torque by e^{-sd},
``torque_filter`` T by 1/(1 + sT), or by 1 − sT where T is negative, and ``position_filter`` T its
position by 1 + sT. ``load`` is a share of the torque through the gear that is friction of its motor.
``ripple`` is a torque of the motor and ``transmission`` a deflection of the gear, both periodic in the
motor's position (``PerTurn``). The others are laws in time (``joint_laws``)."""

ARM_EFFECTS = ("arm_viscous", "link", "gravity")
"""Effects on the arm's dynamic stiffness."""

CHANGES = ("stiffness_change", "damping_change")
"""Slow changes of K and D over the records."""

FILTERS = ("position_filter", "torque_filter")
"""Effects that differ from a delay by the square of their time constants only."""

PERIODIC_EFFECTS = ("ripple", "transmission")
"""Effects that repeat with the turns of a motor."""

FRICTION_EFFECTS = ("load", "motor_presliding", *PERIODIC_EFFECTS)
"""Effects that go with Coulomb and viscous friction."""

GEAR_LAWS = ("cubic", "piecewise", "backlash", "hysteresis")
"""Nonlinear laws of the gear."""

LAWS = (*GEAR_LAWS, "arm_coulomb", "motor_presliding")
"""All nonlinear laws."""


class Meaning(NamedTuple):
    """Name, symbol and unit of the numbers of a block, motor side."""

    name: str
    unit: str
    symbol: str = ""
    """In place of the name in front of the joint's number."""

    def of_joint(self, j: int) -> str:
        """Name of the number of joint ``j``, from 1."""
        return f"{self.symbol or self.name + ' '}{j}"


EFFECT_PARAMETERS = {
    name: Meaning(*text) for effect in EFFECTS.values() for name, text in effect.parameters.items()
}
"""Every block of the effects."""

PARAMETERS = {
    "K": Meaning("stiffness", "N·m/rad", "K"),
    "D": Meaning("damping", "N·m·s/rad", "D"),
    "coulomb": Meaning("Coulomb friction", "N·m"),
    "viscous": Meaning("viscous friction", "N·m·s/rad"),
    "curve": Meaning("friction curve", "N·m"),
    "delay": Meaning("torque delay", "s"),
    **EFFECT_PARAMETERS,
    "M": Meaning("rotor inertia", "kg·m²", "J_m"),
    "M2": Meaning("arm inertia", "kg·m²"),
    "torque_scale": Meaning("torque scale", ""),
}
"""Every block of parameters, in the order of reports."""


class Block(NamedTuple):
    """One named block of a parameter vector."""

    name: str
    """Key of ``PARAMETERS``."""
    shape: tuple[int, ...]
    """Shape of its values; () is a single number."""
    labels: tuple[str, ...] = ()
    """Name of each number for messages and tables, in C order; none in start values."""
    joints: tuple[tuple[int, ...], ...] = ()
    """Joint, from 1, or pair of joints of each number; () where it belongs to all."""


@dataclass(frozen=True)
class ParameterLayout:
    """Order and shapes of the blocks of a parameter vector of P numbers."""

    blocks: tuple[Block, ...]

    @classmethod
    def of(
        cls,
        n: int,
        *,
        friction: bool = False,
        curve_parts: int = 0,
        delay: bool = False,
        effects: Sequence[str] = (),
        rotors: int = 0,
        arms: int = 0,
        torque_scale: bool = False,
    ) -> ParameterLayout:
        """Layout of n joints: K and D, then the further blocks of the model.

        Parameters
        ----------
        n : int
            Number of joints.
        friction : bool
            Coulomb and viscous friction, one number of each per joint.
        curve_parts : int
            Numbers per joint of a friction curve that varies with speed.
        effects : sequence of str
            Keys of ``EFFECTS``.
        rotors, arms : int
            Distinct rotor inertias M and arm inertias M2 to fit.
        delay, torque_scale : bool
            One delay of the torque; one torque scale per joint.
        """
        joints = range(1, n + 1)
        each = tuple((j,) for j in joints)

        def of_joints(name: str) -> Block:
            return Block(name, (n,), tuple(map(PARAMETERS[name].of_joint, joints)), each)

        blocks = [of_joints("K"), of_joints("D")]
        if friction:
            of = [(c, j) for j in joints for c in range(curve_parts)]
            labels = tuple(f"{PARAMETERS['curve'].name} {c + 1} of joint {j}" for c, j in of)
            blocks += [of_joints("coulomb"), of_joints("viscous")]
            blocks.append(Block("curve", (n, curve_parts), labels, tuple((j,) for _, j in of)))
        if delay:
            blocks.append(Block("delay", (), (PARAMETERS["delay"].name,), ((),)))
        for effect in effects:
            if not (friction and effect == "viscous"):
                blocks += map(of_joints, EFFECTS[effect].parameters)
        if rotors:
            names = [
                f"{PARAMETERS['M'].of_joint(j)}{_suffix(m, rotors)}"
                for m in range(rotors)
                for j in joints
            ]
            blocks.append(Block("M", (rotors, n), tuple(names), each * rotors))
        if arms:
            pairs = tuple((i, j) for i in joints for j in range(1, i + 1))
            names = [f"{arm_inertia(i, j)}{_suffix(p, arms)}" for p in range(arms) for i, j in pairs]
            blocks.append(Block("M2", (arms, len(pairs)), tuple(names), pairs * arms))
        if torque_scale:
            blocks.append(of_joints("torque_scale"))
        return cls(tuple(blocks))

    @cached_property
    def _slices(self) -> dict[str, slice]:
        ends = accumulate((prod(block.shape) for block in self.blocks), initial=0)
        return {b.name: slice(*ab) for b, ab in zip(self.blocks, pairwise(ends), strict=True)}

    @cached_property
    def size(self) -> int:
        """Number of parameters P."""
        return sum(prod(block.shape) for block in self.blocks)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Label of every parameter, in their order."""
        return tuple(label for block in self.blocks for label in block.labels)

    @cached_property
    def lowest(self) -> Floats:
        """Lower bounds, shape (P,): backlash and load-dependent friction are not negative."""
        lowest = np.full(self.size, -np.inf)
        for name in {"backlash", "load"}.intersection(self._slices):
            lowest[self[name]] = 0
        return lowest

    def __contains__(self, name: str) -> bool:
        return name in self._slices

    def __getitem__(self, name: str) -> slice:
        """Place of a block in the vector; KeyError names the blocks when there is no such one."""
        if name not in self:
            raise KeyError(f"no block {name!r}, only {', '.join(self._slices)}")
        return self._slices[name]

    def of_part(self, part: str) -> slice:
        """Place of the parameters that a part of a model is judged by, such as "friction"."""
        if part == "friction":
            return self.span("coulomb", "curve")
        return self.span(part, [*EFFECTS[part].parameters][-1] if part in CHANGES else part)

    def span(self, first: str, last: str) -> slice:
        """Place of the blocks from ``first`` to ``last``."""
        return slice(self._slices[first].start, self._slices[last].stop)

    def pack(self, **values: ArrayLike) -> Floats:
        """Parameter vector, shape (P,), from the values of its blocks; those not given are zero."""
        p = np.zeros(self.size)
        for name, value in values.items():
            p[self._slices[name]] = np.ravel(value)
        return p

    def named(self, p: Floats) -> Parameters:
        """View of a parameter vector, shape (P,), by the names of its blocks."""
        return Parameters(self, p)


@dataclass(frozen=True, eq=False)
class Parameters:
    """A parameter vector by the names of its blocks; ``name in p.layout`` tests for a block."""

    layout: ParameterLayout
    vector: Floats
    """Shape (P,)."""

    def __getitem__(self, name: str) -> Floats:
        """Values of a block, in its shape; KeyError when there is no such one."""
        values = self.vector[self.layout[name]]
        return values.reshape(next(b.shape for b in self.layout.blocks if b.name == name))

    def without(self, *names: str) -> Parameters:
        """The parameters without some blocks."""
        layout = ParameterLayout(tuple(each for each in self.layout.blocks if each.name not in names))
        return layout.named(layout.pack(**{each.name: self[each.name] for each in layout.blocks}))

    def effect(self, name: str) -> Floats | float:
        """Values of an effect, shape (n,); 0 where it is not fitted."""
        return self[name] if name in self.layout else 0.0

    @property
    def K(self) -> Floats:
        """Stiffness, shape (n,), N·m/rad."""
        return self["K"]

    @property
    def D(self) -> Floats:
        """Damping, shape (n,), N·m·s/rad."""
        return self["D"]

    @property
    def torque_scale(self) -> Floats | float:
        """Torque over logged torque, shape (n,); 1 where it is not fitted."""
        return self["torque_scale"] if "torque_scale" in self.layout else 1.0

    @property
    def delay(self) -> float:
        """Seconds by which the torque lags; 0 where it is not fitted."""
        return float(self["delay"]) if "delay" in self.layout else 0.0


def _suffix(index: int, count: int) -> str:
    return f", pose {index + 1}" if count > 1 else ""


def elasticity_labels(n: int) -> tuple[str, ...]:
    """K1 ... Kn, D1 ... Dn: the order of a fit's estimate and covariance."""
    return ParameterLayout.of(n).labels
