"""Plausibility check of the inertias: K, D, M and M2 fitted together to one pose.

The method takes the inertias as known. Records at enough frequencies determine them as well, less
accurately: at low frequency H tends to (M + M2)⁻¹, at high frequency to M⁻¹.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.errors import JointIdError
from jointid.estimation.joint_equations import spring_equations
from jointid.estimation.parameters import Block, ParameterLayout, Parameters
from jointid.joints import Inertia, arm_inertias, motor_impedance
from jointid.phasors.extract import Phasors
from jointid.small_matrices import covariance_of, whitener

_PRIOR = 0.3
"""Relative prior standard deviation of the inertias; it determines what the records do not."""

_ITERATIONS = 25
"""Upper limit of Levenberg-Marquardt."""
_LEAST_DAMPING = 1e-12
"""Of the normal matrix of unit diagonal."""


@dataclass(frozen=True, eq=False)
class InertiaCheck:
    """Inertias fitted to the records, next to those given."""

    names: tuple[str, ...]
    given: Floats
    """Shape (E,), kg·m²."""
    found: Floats
    """Shape (E,), kg·m²."""
    standard_error: Floats
    """Of ``found``, times the root of the remaining misfit if above 1, shape (E,)."""
    estimate: Floats
    """K1 ... Kn, D1 ... Dn with these inertias, shape (2n,)."""
    misfit_given: float
    """Cost over its expected value with the given inertias."""
    misfit_found: float
    """The same with the fitted inertias."""

    @property
    def significance(self) -> Floats:
        """Distance of found from given in standard errors, shape (E,)."""
        return np.asarray(np.abs(self.found - self.given) / self.standard_error)


def check_inertia(phasors: Phasors, inertia: Inertia, K: Floats, D: Floats) -> InertiaCheck:
    """Fit inertias of one pose together with K and D to the fundamentals, from K and D as found.

    Parameters
    ----------
    phasors : Phasors
        Of one pose, free of friction and delay.
    inertia : Inertia
    K, D : ndarray, shape (n,)

    Raises
    ------
    JointIdError
        When the records are too few.
    """
    layout = _layout(phasors.n)
    upper, own = np.triu_indices(phasors.n), np.diag(inertia.M2)
    start = layout.pack(K=K, D=D, M=inertia.M, M2=inertia.M2[upper])
    size = layout.pack(
        K=K,
        D=np.maximum(np.abs(D), 1e-3 * K / phasors.omega.mean()),
        M=inertia.M,
        M2=np.sqrt(np.outer(own, own)[upper]),
    )
    rows = 2 * phasors.q.size
    if rows < 2 * size.size:
        raise JointIdError("There are too few records to check the inertias by.")
    noise = spring_equations(phasors, inertia).noise.covariance[:, 0]
    springs, inertias = layout.span("K", "D"), layout.span("M", "M2")
    count = springs.stop
    fixed, cost_given, _ = _minimise(phasors, noise, layout, start, size, count)
    found, cost, information = _minimise(phasors, noise, layout, fixed, size, start.size)
    misfit = 2 * cost / (rows - size.size)
    covariance = covariance_of(information / max(1.0, misfit))
    error = np.sqrt(np.diag(covariance)) * size
    return InertiaCheck(
        names=layout.labels[inertias],
        given=start[inertias],
        found=found[inertias],
        standard_error=error[inertias],
        estimate=found[springs],
        misfit_given=2 * cost_given / (rows - count),
        misfit_found=misfit,
    )


def _layout(n: int) -> ParameterLayout:
    """K, D, M and the upper triangle of M2."""
    names = tuple(name for name, _, _ in arm_inertias(n))
    rotors = Block("M", (n,), tuple(f"J_m{j + 1}" for j in range(n)))
    return ParameterLayout((*ParameterLayout.of(n).blocks, rotors, Block("M2", (len(names),), names)))


def _minimise(
    phasors: Phasors,
    noise: Complexes,
    layout: ParameterLayout,
    start: Floats,
    size: Floats,
    count: int,
) -> tuple[Floats, float, Floats]:
    """Levenberg-Marquardt on Σ rᴴV⁻¹r and the prior over the first ``count`` parameters.

    Returns parameters, cost and information.
    """
    prior = np.zeros(start.size)
    prior[layout.span("M", "M2")] = 1 / _PRIOR**2
    prior, free = prior[:count], slice(count)
    origin, p, damping = start, start.copy(), 1e-3

    def whitened(at: Floats, root: Complexes) -> Floats:
        r = (root @ _residual(phasors, layout.named(at))[0][..., None])[..., 0].ravel()
        return np.concatenate([r.real, r.imag])

    def total(at: Floats, row: Floats) -> float:
        return float(2 * row @ row + prior @ ((at - origin)[free] / size[free]) ** 2)

    information = np.eye(count)
    for _ in range(_ITERATIONS):
        root = _whitening(phasors, noise, layout.named(p))
        row = whitened(p, root)
        J = np.empty((row.size, count))
        for k in range(count):
            step = np.zeros(p.size)
            step[k] = 1e-6 * size[k]
            J[:, k] = (whitened(p + step, root) - whitened(p - step, root)) / 2e-6
        information = 2 * J.T @ J + np.diag(prior)
        gradient = 2 * J.T @ row + prior * ((p - origin)[free] / size[free])
        before = total(p, row)
        while damping < 1e8:
            scaled = information + damping * np.diag(np.diag(information))
            trial = p.copy()
            trial[free] -= size[free] * np.linalg.solve(scaled, gradient)
            if _is_possible(layout.named(trial)):
                after = total(trial, whitened(trial, root))
                if after <= before:
                    break
            damping *= 10
        else:
            break
        p, damping = trial, max(damping / 10, _LEAST_DAMPING)
        if before - after < 1e-6 * max(after, 1.0):
            break
    row = whitened(p, _whitening(phasors, noise, layout.named(p)))
    return p, float(row @ row), information


def _is_possible(p: Parameters) -> bool:
    """Whether K, M and M2 are positive."""
    return bool(np.all(p.K > 0) and np.all(p["M"] > 0) and np.linalg.eigvalsh(_arm(p))[0] > 0)


def _arm(p: Parameters) -> Floats:
    """M2, shape (n, n)."""
    M2 = np.zeros((p.K.size, p.K.size))
    M2[np.triu_indices(p.K.size)] = p["M2"]
    return M2 + np.triu(M2, 1).T


def _residual(phasors: Phasors, p: Parameters) -> tuple[Complexes, Complexes]:
    """Residual torque (r, n), and the gain E (r, n, 2n) of z in it."""
    s: Complexes = np.multiply(1j, phasors.omega)
    arm = np.asarray(np.linalg.inv(_arm(p)), float)
    Z, _ = motor_impedance(s, p["M"], arm, p.K, p.D)
    E = np.concatenate([-Z, np.broadcast_to(np.eye(phasors.n), Z.shape)], axis=2)
    return (E @ phasors.z[..., None])[..., 0], E


def _whitening(phasors: Phasors, noise: Complexes, p: Parameters) -> Complexes:
    E = _residual(phasors, p)[1]
    return whitener(E @ noise @ E.conj().swapaxes(1, 2))
