"""Start values of K, D and friction where friction spoils least squares.

Plain least squares takes friction for elasticity: with half of the torque, K may come out at a tenth.
Here the torque of the model, Z(K, D) q, is compared with the measured one at the fundamental, in
relative terms and with a loss that forgives outliers. Coulomb and viscous friction are linear in it and
are eliminated (variable projection; Golub and Pereyra, SIAM Journal on Numerical Analysis 10, 1973).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from jointid.arrays import Complexes, Floats
from jointid.estimation.friction import friction_waveforms
from jointid.estimation.inertia_prior import InertiaPrior
from jointid.estimation.joint_equations import inertia_arrays
from jointid.estimation.parameters import ParameterLayout, Parameters
from jointid.joints import motor_impedance
from jointid.phasors.extract import Phasors

_UNEXPLAINED = 0.1
"""Relative residual of the linear estimate from which friction is looked for."""
_OUTLIER = 0.1
"""Relative residual from which a record counts less."""
_BETTER = 0.5
"""Residual over that of the linear estimate below which the new start is taken."""
_STARTS = 0.75, 0.5, 1.0
"""Quantiles of the frequencies at which the arm resonates with the motors held."""
_EVALUATIONS = 30
"""Most Jacobians from each of them."""
_RANGE = 1e6
"""Largest factor on a start value."""


@dataclass(frozen=True, eq=False)
class _Fundamentals:
    """Torques at the fundamental, and the friction phasors of each joint."""

    phasors: Phasors
    M: Floats
    arm: Floats
    friction: Complexes
    """Of Coulomb and viscous friction, shape (r, n, 2)."""
    moving: np.ndarray
    """Whether a joint moves in a record, shape (r, n)."""

    def residual(self, p: Floats) -> tuple[Floats, Floats]:
        """Relative residual, shape (rows,), at the logarithms of K and D, and the friction, (2, n)."""
        n, ph = self.phasors.n, self.phasors
        s = np.asarray(1j * ph.omega, np.complex128)
        Z, _ = motor_impedance(s, self.M, self.arm, *np.exp(p.reshape(2, n)))
        rest = ph.tau - (Z @ ph.q[..., None])[..., 0]
        residual, found = [], np.zeros((2, n))
        for j in range(n):
            used = self.moving[:, j] & (np.abs(ph.tau[:, j]) > 0)
            weight = 1 / np.abs(ph.tau[used, j])
            A, b = (_real(x * w) for x, w in (
                (self.friction[used, j], weight[:, None]), (rest[used, j], weight)
            ))  # fmt: skip
            found[:, j] = np.maximum(np.linalg.lstsq(A, b, rcond=None)[0], 0.0)
            residual.append(b - A @ found[:, j])
        return np.concatenate(residual), found

    def relative(self, p: Floats) -> Floats:
        """The residual alone."""
        return self.residual(p)[0]


def friction_start(phasors: Phasors, prior: InertiaPrior, linear: Parameters) -> Parameters | None:
    """Return K, D and the friction of all joints; None where the linear estimate is as good.

    Parameters
    ----------
    phasors : Phasors
        r records of n joints.
    prior : InertiaPrior
    linear : Parameters
        K and D by least squares.
    """
    n = phasors.n
    waveforms = friction_waveforms(phasors, 0.0)
    viscous = 1j * phasors.omega[:, None] * phasors.q
    data = _Fundamentals(
        phasors,
        *inertia_arrays(phasors, prior.inertias(prior.M, prior.M2)),
        np.stack([waveforms.coulomb[:, 0], viscous], axis=2),
        ~waveforms.stationary,
    )
    least = np.inf
    if np.all(linear.K > 0) and np.all(linear.D > 0):
        least = _size(data.residual(np.log(np.concatenate([linear.K, linear.D])))[0])
    if least < _UNEXPLAINED:
        return None
    own = np.diagonal(prior.M2[prior.pose], axis1=1, axis2=2).mean(axis=0)
    best, start = _BETTER * least, None
    for share in _STARTS:
        omega = float(np.quantile(phasors.omega, share))
        first = np.log(np.concatenate([own * omega**2, 0.05 * own * omega]))
        found = least_squares(
            data.relative,
            first,
            bounds=(first - np.log(_RANGE), first + np.log(_RANGE)),
            loss="soft_l1",
            f_scale=_OUTLIER,
            ftol=1e-3,
            max_nfev=_EVALUATIONS,
        )
        residual, friction = data.residual(found.x)
        if _size(residual) < best:
            best, (K, D) = _size(residual), np.exp(found.x.reshape(2, n))
            layout = ParameterLayout.of(n, friction=True)
            values = layout.pack(K=K, D=D, coulomb=friction[0], viscous=friction[1])
            start = layout.named(values)
        if best < _UNEXPLAINED:
            break
    return start


def _size(residual: Floats) -> float:
    """Typical size: outliers do not count."""
    return float(np.median(np.abs(residual))) if residual.size else np.inf


def _real(values: Complexes) -> Floats:
    return np.concatenate([values.real, values.imag])
