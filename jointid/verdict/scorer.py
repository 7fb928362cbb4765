"""Score of hypotheses on wrong data: a linear fit of K and D to the records corrected by each one.

A hypothesis changes the matrices that map the logged phasors z = [q; τ] to a and b of the joint
equations (K_j + iωD_j) a_j = b_j. The noise of z is the same for all of them, and many are fitted at
once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.estimation.estimators.joint_equations import inertia_arrays
from jointid.joints import Inertia, dynamic_arm_inertia
from jointid.phasors.extract import Phasors

VELOCITY = "velocity"
"""Kind of the hypothesis that positions are velocities."""
_FLOOR = 1e-9
"""Smallest standard deviation of a phasor, over the signal's largest."""
_WEIGHT_ITERATIONS = 3
"""Updates of the weights, which depend on K and D."""
_ROUNDING = 1e-15
"""Rounding error of a variance, over the terms that cancel in it."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A possible fault of the records or the inertias of n joints."""

    kind: str
    scale: Floats
    """Logged over true angles, then torques, shape (2n,)."""
    gear: Floats
    """Gear ratios by which M2 is to be divided on both sides, shape (n,)."""
    order: np.ndarray
    """Column of z that holds the angle, then the torque, of each joint, shape (2n,)."""

    @classmethod
    def of(cls, kind: str, angle: Floats, torque: Floats) -> Hypothesis:
        """Return a hypothesis on the scales of angles and torques, each shape (n,)."""
        n = angle.size
        return cls(kind, np.concatenate([angle, torque]), np.ones(n), np.arange(2 * n))

    @property
    def factor(self) -> Floats:
        """Torque over acceleration, logged over true, shape (n,)."""
        angle, torque = np.split(self.scale, 2)
        return np.asarray(torque / angle)

    def corrected(self, phasors: Phasors) -> Phasors:
        """Phasors with true angles and torques, where these are scaled."""
        return corrected(phasors, np.broadcast_to(self.scale, phasors.z.shape))

    def inertia(self, given: Inertia) -> Inertia:
        """Inertia of the joints as logged, where whole axes are exchanged or reversed."""
        n = given.n
        place, sign = np.argsort(self.order[:n]), self.scale[:n]
        arms = [getattr(given, f.name) * np.outer(sign, sign) for f in fields(given) if f.name != "M"]
        return Inertia(given.M[place], *(arm[np.ix_(place, place)] for arm in arms))


def corrected(phasors: Phasors, scale: Floats | Complexes) -> Phasors:
    """Phasors divided by the scale of each record's angles, then torques.

    Its shape is (r, 2n), or (r, H, 2n) by harmonic.
    """
    scale = scale if scale.ndim == 3 else scale[:, None]
    square = scale[..., :, None] * scale[..., None, :].conj()
    return replace(
        phasors,
        q=phasors.q / scale[:, 0, : phasors.n],
        tau=phasors.tau / scale[:, 0, phasors.n :],
        covariance=phasors.covariance / square[:, 0],
        harmonics=phasors.harmonics / scale,
        harmonic_covariance=phasors.harmonic_covariance / square,
    )


def simplest(cost: Floats) -> int:
    """Index of the first hypothesis, hence the simplest, with a cost near the least or that of noise."""
    return int(np.argmax(cost <= 2 * max(cost.min(), 1.0)))


@dataclass(frozen=True, eq=False)
class Scores:
    """Fits of B hypotheses."""

    K: Floats
    """Shape (B, n)."""
    D: Floats
    """Shape (B, n)."""
    misfit: Floats
    """Cost over its expected value, shape (B,)."""
    cost: Floats
    """The misfit, infinite where a K is not positive or a D significantly negative, shape (B,)."""


@dataclass(frozen=True, eq=False)
class Scorer:
    """Fundamentals of r records of n joints, with their noise and inertias."""

    omega: Floats
    z: Complexes
    noise: Complexes
    """Covariance of z, shape (r, 2n, 2n)."""
    inverse_bias: Floats
    """Mean factor by which the inverse of an estimated variance is too large, shape (r,)."""
    M: Floats
    """Shape (r, n)."""
    M2: Floats
    """Shape (r, n, n)."""
    gravity: Floats
    """Contribution of gravity to M2 at the frequency of each record, shape (r, n, n)."""

    @classmethod
    def of(cls, phasors: Phasors, inertias: Sequence[Inertia]) -> Scorer:
        """Collect phasors and inertias, one per record."""
        largest = np.abs(phasors.z).max(axis=0)
        degrees_of_freedom = np.maximum(phasors.degrees_of_freedom, 2.0)
        M2 = np.array([each.M2 for each in inertias])
        return cls(
            omega=phasors.omega,
            z=phasors.z,
            noise=phasors.covariance + np.diag((_FLOOR * largest) ** 2),
            inverse_bias=degrees_of_freedom / (degrees_of_freedom - 1),
            M=inertia_arrays(phasors, inertias)[0],
            M2=M2,
            gravity=dynamic_arm_inertia(phasors.omega, inertias) - M2,
        )

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.M.shape[1])

    def corrected(self, record: int, scale: Floats) -> Scorer:
        """Divide z of one record by ``scale``, shape (2n,)."""
        factor = np.ones(self.z.shape)
        factor[record] = 1 / scale
        noise = self.noise * factor[:, :, None] * factor[:, None]
        return replace(self, z=self.z * factor, noise=noise)

    def as_logged(self) -> Hypothesis:
        """Return the hypothesis that nothing is wrong."""
        return Hypothesis.of("", np.ones(self.n), np.ones(self.n))

    def scores(self, hypotheses: Sequence[Hypothesis], use: Floats | None = None) -> Scores:
        """Fit every hypothesis.

        Parameters
        ----------
        use : ndarray, shape (B, r), optional
            1 for records that count, 0 for others. With several hypotheses one row for each; with one
            hypothesis any number of rows.
        """
        maps = [self.equations(hypothesis) for hypothesis in hypotheses]
        of_a, of_b = (np.array(each) for each in zip(*maps, strict=True))
        use = np.ones((1, self.omega.size)) if use is None else use
        with np.errstate(all="ignore"):
            return self._fitted(of_a, of_b, use[..., None])

    def equations(self, hypothesis: Hypothesis) -> tuple[Floats | Complexes, Floats | Complexes]:
        """Matrices of a and b for the logged z, each shape (r, n, 2n)."""
        n, s2, gear = self.n, -(self.omega[:, None, None] ** 2), hypothesis.gear
        M2, M = self.M2 / np.outer(gear, gear) + self.gravity, self.M[:, :, None] * np.eye(n)
        none = np.zeros(M2.shape)
        eye: Floats = np.eye(n) + none
        if hypothesis.kind == "arm angle":  # the motors turn by M2 s²q / (K + sD) more
            a, b = [-s2 * (M2 + M), eye], [s2 * s2 * M @ M2, none]
        else:
            if hypothesis.kind == "gear torque":  # without the torque that moves the rotors
                M = none
            arm = np.asarray(np.linalg.inv(M2), np.float64)
            a, b = [(eye + arm @ M) * s2, -arm], [-M * s2 * s2, s2 * eye]
        if hypothesis.kind == VELOCITY:
            a[0], b[0] = (each[0] / (1j * self.omega[:, None, None]) for each in (a, b))
        columns = np.argsort(hypothesis.order)
        return tuple(  # type: ignore[return-value]
            (np.concatenate(each, axis=2) / hypothesis.scale)[..., columns] for each in (a, b)
        )

    def _fitted(self, of_a: Floats | Complexes, of_b: Floats | Complexes, use: Floats) -> Scores:
        omega = self.omega[:, None]
        a, b = ((each @ self.z[..., None])[..., 0] for each in (of_a, of_b))
        through = of_a @ self.noise
        var_a = (through * of_a.conj()).sum(axis=-1).real
        cov = (through * of_b.conj()).sum(axis=-1).conj()  # of b with a
        var_b = ((of_b @ self.noise) * of_b.conj()).sum(axis=-1).real
        power, product = use * np.abs(a) ** 2, use * a.conj() * b
        weight: Floats = np.ones_like(power)
        for last in range(_WEIGHT_ITERATIONS + 1):
            of_K, of_D = (weight * power).sum(axis=-2), (weight * omega**2 * power).sum(axis=-2)
            K = (weight * product.real).sum(axis=-2) / of_K
            D = (weight * omega * product.imag).sum(axis=-2) / of_D
            spring = K[..., None, :] + 1j * omega * D[..., None, :]
            terms = var_b + np.abs(spring) ** 2 * var_a
            variance = terms - 2 * (spring.conj() * cov).real
            variance = np.maximum(variance, _ROUNDING * terms) * self.inverse_bias[:, None]
            if last < _WEIGHT_ITERATIONS:
                weight = 1 / variance
        squares = use * np.abs(b - spring * a) ** 2 / variance
        left = self.n * (use[..., 0].sum(axis=-1) - 1)
        misfit = np.where(left > 0, squares.sum(axis=(-2, -1)) / np.maximum(left, 1), 1.0)
        sigma_D = np.sqrt(0.5 * np.maximum(misfit, 1)[:, None] / of_D)
        excited = (use * np.abs(a) ** 2).sum(axis=-2) / (use * var_a).sum(axis=-2)
        seen = excited > (1 + 3 / np.sqrt(use.sum(axis=-2))) ** 2
        possible = np.all((K > 0) & (-4 * sigma_D < D) & seen, axis=-1) & np.isfinite(misfit)
        return Scores(
            K, D, np.where(np.isnan(misfit), np.inf, misfit), np.where(possible, misfit, np.inf)
        )
