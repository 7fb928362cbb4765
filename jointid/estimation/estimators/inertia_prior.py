"""Inertias and torque scales as given, with their uncertainty: the prior of the fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from numbers import Real

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.estimators.parameters import Parameters
from jointid.joints import Inertia
from jointid.motion.arm_motion import DrivenArms
from jointid.phasors.extract import Phasors
from jointid.phasors.segment import Motors
from jointid.small_matrices import Numbers
from jointid.wording import counted

_LEAST_COUPLING = 0.1
"""A coupling's standard deviation is at least this share of that of √(M2_ii M2_jj): one given as 0 must
stay free."""

_EXACT, _UNKNOWN = 1e-12, 1e6
"""Relative standard deviations below and above which a value counts as exact and as unknown."""

_MODEL_STD = 1e-4
"""Least relative standard deviation of M2 in addition to that of a common unknown."""

_LINK_SHARE, _LEAST_LINK_SHARE = 0.2, 1e-3
"""Share of a usual arm that bends with its link, and of one whose M2 is nearly singular."""

_ROUNDING = 1e-9
"""Difference between inertias, over the largest element, that counts as rounding."""


def inertia_of_each(
    inertia: Inertia | Sequence[Inertia], records: int, joints: int
) -> Sequence[Inertia]:
    """One inertia per record, from one for all or a sequence of as many."""
    each = [inertia] * records if isinstance(inertia, Inertia) else inertia
    if not isinstance(each, Sequence) or not all(isinstance(one, Inertia) for one in each):
        raise JointIdError(f"inertia = {inertia!r:.60}: expected an Inertia, or one per record.")
    if len(each) != records:
        raise JointIdError(f"{len(each)} inertias for {records} records: give one, or one per record.")
    wrong = next((one.n for one in each if one.n != joints), None)
    if wrong is not None:
        has = f"The records have {counted(joints, 'joint')}, but the inertia has {wrong}"
        raise JointIdError(f"{has}: give one M per joint of the records.")
    return each


@dataclass(frozen=True, eq=False)
class InertiaPrior:
    """Rotor inertias M, arm inertias M2 of each pose, and torque scales, with standard deviations.

    Records with equal arrays share them: usually one M, and one M2 per pose. Of M2, the part
    ``Inertia.added`` is exact and the rest is uncertain; poses that differ by it alone share the rest.
    """

    given: Inertia | tuple[Inertia, ...]
    """As given: one for all records, or one per record."""
    M: Floats
    """Distinct rotor inertias, shape (m, n), kg·m²."""
    M2: Floats
    """Distinct arm inertias, shape (p, n, n), kg·m²."""
    added: Floats
    """``Inertia.added`` of each M2, shape (p, n, n)."""
    gravity: Floats
    """``Inertia.gravity`` with each M2, shape (p, n, n)."""
    shared: Floats
    """``Inertia.shared`` of each uncertain part, shape (u, n, n)."""
    shared_gravity: Floats
    """``Inertia.shared_gravity`` with each M2, shape (p, n, n)."""
    rest: Floats
    """Distinct uncertain parts M2 − added, shape (u, n, n), kg·m²."""
    rotor: np.ndarray
    """Row of M of each record, shape (r,)."""
    pose: np.ndarray
    """Matrix of M2 of each record, shape (r,)."""
    part: np.ndarray
    """Uncertain part of each M2, shape (p,)."""
    inertia_std: float = 0.0
    """Relative standard deviation of M and M2; 0: exact, inf: unknown."""
    torque_std: float = 0.0
    """Relative standard deviation of each joint's torque scale; 0: exact, inf: unknown."""
    offsets: Mapping[str, Floats] = field(default_factory=dict)
    """Added to the mean of each block, see ``redrawn``."""

    @classmethod
    def of(
        cls,
        inertia: Inertia | Sequence[Inertia] | InertiaPrior,
        records: int,
        joints: int,
        *,
        inertia_std: float | None = None,
        torque_std: float | None = None,
    ) -> InertiaPrior:
        """Collect the inertias of r records.

        ``inertia`` is one for all records, or one per record when they come from several poses; a prior
        is returned as it is. The relative standard deviations are 0 for None. Raises JointIdError when
        the inertias do not match the records, or a standard deviation is negative or NaN.
        """
        if isinstance(inertia, InertiaPrior):
            return inertia
        each = inertia_of_each(inertia, records, joints)
        M, rotor = _distinct([one.M for one in each])
        parts, pose = _distinct([_parts(one) for one in each])
        rest, part = _distinct(list(parts[:, 0]))
        return cls(
            given=inertia if isinstance(inertia, Inertia) else tuple(each),
            M=M,
            M2=parts[:, 0] + parts[:, 1],
            added=parts[:, 1],
            gravity=parts[:, 2],
            shared=np.array([parts[pose][part[pose] == k][0, 3] for k in range(len(rest))]),
            shared_gravity=parts[:, 4],
            rest=rest,
            rotor=rotor,
            pose=pose,
            part=part,
            inertia_std=checked_std("inertia_std", inertia_std),
            torque_std=checked_std("torque_std", torque_std),
        )

    def like(self, inertia: Inertia | Sequence[Inertia], shape: tuple[int, ...]) -> InertiaPrior:
        """Prior of other inertias or records, shape (records, joints), as uncertain as this one."""
        return InertiaPrior.of(inertia, *shape, inertia_std=self.inertia_std, torque_std=self.torque_std)

    def of_rows(self, records: np.ndarray) -> InertiaPrior:
        """Prior with one row for each index of a record, shape (rows,)."""
        return replace(self, rotor=self.rotor[records], pose=self.pose[records])

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.M.shape[1])

    @cached_property
    def elements(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns of a matrix's distinct elements, the lower triangle, each shape (t,)."""
        return np.tril_indices(self.n)

    @cached_property
    def lower(self) -> Floats:
        """Distinct elements of each uncertain part of M2, shape (u, t), kg·m²."""
        rows, columns = self.elements
        return np.asarray(self.rest[:, rows, columns])

    @cached_property
    def units(self) -> dict[str, Floats]:
        """Standard deviation of each block for a relative one of 1, shaped like the block."""
        rows, columns = self.elements
        size = np.sqrt(self.rest[:, rows, rows] * self.rest[:, columns, columns])
        coupled = np.maximum(np.abs(self.lower), _LEAST_COUPLING * size)
        return {"M": self.M, "M2": coupled, "torque_scale": np.ones(self.n)}

    def blocks(self) -> dict[str, tuple[Floats, Floats]]:
        """Mean and standard deviation of each uncertain block of the parameter vector."""
        blocks = {}
        if self.inertia_std > 0:
            blocks["M"] = self.M, self.inertia_std * self.units["M"]
        if self.inertia_std > 0 or self.shared.any():
            blocks["M2"] = self.lower, np.hypot(self._own, self.common)
        if self.torque_std > 0:
            blocks["torque_scale"] = np.ones(self.n), self.torque_std * self.units["torque_scale"]
        return {name: (mean + self.offsets.get(name, 0.0), std) for name, (mean, std) in blocks.items()}

    @property
    def common(self) -> Floats:
        """Distinct elements of ``shared``, shape (u, t), kg·m²."""
        rows, columns = self.elements
        return np.asarray(self.shared[:, rows, columns])

    @property
    def _own(self) -> Floats:
        """Standard deviation of each element of M2 beside the common unknown's, shape (u, t), kg·m²."""
        least = _MODEL_STD if self.shared.any() else 0.0
        return np.asarray(max(self.inertia_std, least) * self.units["M2"])

    def link_std(self, K: Floats, times: float) -> Floats:
        """Standard deviation of a usual link's flexibility J/ω², shape (n,), kg·m²·s².

        Of links with modes at ``times`` the joint's resonance with the motor free.
        """
        arm = np.diag(self.M2.mean(axis=0))
        squared = np.abs(K) * (1 / self.M.mean(axis=0) + 1 / arm)
        return np.asarray(self.link_inertia / (times**2 * squared))

    @property
    def link_inertia(self) -> Floats:
        """Inertia J of usual links behind their flexibility, shape (n,), kg·m².

        A coupling allows less: M2 without it stays positive definite.
        """
        M2 = self.M2.mean(axis=0)
        arm = np.diag(M2)
        rest = float(np.linalg.eigvalsh(M2 / np.sqrt(np.outer(arm, arm)))[0])
        return np.asarray(np.clip(rest / 2, _LEAST_LINK_SHARE, _LINK_SHARE) * arm)

    def covariance(self, name: str) -> Floats:
        """Covariance of the values of one block, shape (E, E); infinite where they are unknown."""
        if name != "M2":
            return np.diag(self.blocks()[name][1].ravel() ** 2)
        common = self.common.ravel()
        return np.asarray(np.diag(self._own.ravel() ** 2) + np.outer(common, common))

    def motors(self, phasors: Phasors, p: Parameters) -> list[Motors]:
        """Parameters of the motors in every record; the phasors of sines hold the stated delays already.

        The rotors of a part of the records have the inertias of the prior.
        """
        is_fitted = "M" in p.layout and p["M"].shape == self.M.shape
        M = (p["M"] if is_fitted else self.M)[self.rotor]
        stated = np.where(phasors.motion, phasors.torque_delay_s, 0.0)
        lags = stated[:, None] + p.delay + p.effect("lag")
        rise = p["curve"].sum(axis=1) if "curve" in p.layout else 0.0
        level = p.effect("coulomb") + p.effect("motor_presliding")
        values = level, p.effect("viscous"), p.effect("load"), p.torque_scale, rise
        level, viscous, load, scale, rise = (np.broadcast_to(each, phasors.n) for each in values)
        lags = np.broadcast_to(lags, (len(M), phasors.n))
        rotors = zip(M, lags, strict=True)
        return [Motors(own, level, viscous, load, lag, scale, rise) for own, lag in rotors]

    def arms(self, p: Parameters) -> list[DrivenArms]:
        """Gears and arms of every record."""
        M2, gravity = self.M2, self.gravity
        if "M2" in p.layout and p["M2"].shape == self.lower.shape:
            M2, gravity = self.totals(p["M2"]), self.gravities(p["M2"])
        coulomb, viscous = (
            np.broadcast_to(p.effect(f"arm_{kind}"), self.n) for kind in ("coulomb", "viscous")
        )
        held = gravity + np.diag(np.broadcast_to(p.effect("gravity"), self.n))
        of_poses = [DrivenArms(p.K, p.D, coulomb, viscous, *own) for own in zip(M2, held, strict=True)]
        return [of_poses[pose] for pose in self.pose]

    def information(self, name: str) -> Floats:
        """Inverse of ``covariance``, shape (E, E); zero where the values are unknown."""
        if name != "M2":
            return np.diag(self.blocks()[name][1].ravel() ** -2.0)
        weight, common = self._own.ravel() ** -2.0, self.common.ravel()
        seen = weight * common
        return np.asarray(np.diag(weight) - np.outer(seen, seen) / (1 + seen @ common))

    def redrawn(self, rng: np.random.Generator, true: Parameters) -> InertiaPrior:
        """Prior with given values drawn around the true ones; unknown ones stay.

        The offsets may make an inertia negative or M2 indefinite, which a mean may be.
        """
        offsets = {}
        for name, (mean, std) in self.blocks().items():
            known = np.isfinite(std)
            own = self._own if name == "M2" else std
            error = np.where(known, own, 0.0) * rng.standard_normal(std.shape)
            if name == "M2" and self.shared.any():
                error += self.common * rng.standard_normal()
            offsets[name] = np.where(known, true[name] + error - mean, 0.0)
        return replace(self, offsets=offsets)

    def symmetric(self, lower: Floats) -> Floats:
        """Matrices, shape (u, n, n), of lower triangles, shape (u, t)."""
        rows, columns = self.elements
        matrices = np.empty((len(lower), self.n, self.n))
        matrices[:, rows, columns] = lower
        matrices[:, columns, rows] = lower
        return matrices

    def by_elements(self, share: Numbers, vector: Numbers) -> Numbers:
        """share · ∂M2 · vector for each distinct element, (..., n, t), of (..., n, n) and (..., n)."""
        rows, columns = self.elements
        found = share[..., rows] * vector[..., None, columns]
        coupling = rows != columns
        found[..., coupling] += share[..., columns[coupling]] * vector[..., None, rows[coupling]]
        return found

    @cached_property
    def by_lower_element(self) -> Floats:
        """Derivatives of M2 of every pose by each distinct element of the parts, (u t, p, n, n)."""
        count = self.lower.size
        unit = np.eye(count).reshape(count, *self.lower.shape)
        return np.stack([self.symmetric(each)[self.part] for each in unit])

    def totals(self, lower: Floats) -> Floats:
        """M2 of each pose, shape (p, n, n), of lower triangles of its uncertain part, shape (u, t)."""
        return np.asarray(self.symmetric(lower)[self.part] + self.added)

    @cached_property
    def by_lower(self) -> Floats:
        """Share of the common unknown's σ in a change of each distinct element of M2, shape (u t,)."""
        weight, common = self._own.ravel() ** -2.0, self.common.ravel()
        return np.asarray(weight * common / (1 + weight @ common**2))

    def gravities(self, lower: Floats) -> Floats:
        """Gravity stiffness with each M2, shape (p, n, n), at lower triangles of shape (u, t).

        A change of M2 by the common unknown changes the gravity alike.
        """
        if not self.shared_gravity.any():
            return self.gravity
        return np.asarray(
            self.gravity + self.shared_gravity * (self.by_lower @ (lower - self.lower).ravel())
        )

    def inertias(self, M: Floats, M2: Floats, gravity: Floats | None = None) -> list[Inertia]:
        """Inertia of each record from distinct M, shape (m, n), M2 and gravity, shapes (p, n, n)."""
        gravity = self.gravity if gravity is None else gravity
        pairs = list(zip(self.rotor.tolist(), self.pose.tolist(), strict=True))
        distinct = {(m, p): Inertia(M[m], M2[p], self.added[p], gravity[p]) for m, p in set(pairs)}
        return [distinct[pair] for pair in pairs]


def _parts(inertia: Inertia) -> Floats:
    rest = inertia.M2 - inertia.added
    return np.stack([rest, inertia.added, inertia.gravity, inertia.shared, inertia.shared_gravity])


def _distinct(arrays: Sequence[Floats]) -> tuple[Floats, np.ndarray]:
    """Arrays that differ by more than rounding, in order of appearance, and the index of each."""
    found: list[Floats] = []
    index = []
    for array in arrays:
        limit = _ROUNDING * np.abs(array).max()
        same = (k for k, other in enumerate(found) if np.abs(array - other).max() <= limit)
        index.append(next(same, len(found)))
        if index[-1] == len(found):
            found.append(array)
    return np.array(found), np.array(index)


def checked_std(name: str, value: object) -> float:
    """Return a relative standard deviation as a float, None as 0.

    One too small to matter is 0, exact; one too large to have an effect is infinite, unknown. Raises
    JointIdError when it is negative, NaN or no number.
    """
    if value is None:
        return 0.0
    std = np.nan if isinstance(value, bool) or not isinstance(value, Real) else float(value)
    if not std >= 0:
        raise JointIdError(
            f"{name} = {value!r:.60}: expected a relative standard deviation, such as 0.05 for 5 %, "
            "0 for exact values, or infinity for unknown ones."
        )
    return 0.0 if std < _EXACT else np.inf if std > _UNKNOWN else std
