"""Would the records rather have other inertias? K, D, M and M2 fitted together, as a check only.

The method takes the inertias as known. With records at enough frequencies they follow from the
records as well, only less surely: at low frequency H tends to (M + M2)⁻¹, at high frequency to M⁻¹.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.errors import JointIdError
from jointid.joints import Inertia
from jointid.phasors import Phasors
from jointid.small_matrices import covariance_of, whitener
from jointid.springs import spring_equations

_PRIOR = 0.3
"""Relative standard deviation within which inertias are looked for; holds what no record tells."""

_PASSES = 25
_LEAST_DAMPING = 1e-12


@dataclass(frozen=True, eq=False)
class InertiaCheck:
    """Inertias as the records would have them."""

    names: tuple[str, ...]
    given: Floats
    """Shape (E,), kg·m²."""
    found: Floats
    """Shape (E,), kg·m²."""
    standard_error: Floats
    """Of ``found``, times the misfit that is left where that is above 1, shape (E,)."""
    estimate: Floats
    """K1 ... Kn, D1 ... Dn with these inertias, shape (2n,)."""
    misfit_given: float
    """Cost over its expected value with the inertias as given."""
    misfit_found: float
    """The same with those found."""

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
    n, given = phasors.n, inertia
    pairs = [(i, j) for i in range(n) for j in range(i, n)]
    size = np.concatenate([K, np.maximum(np.abs(D), 1e-3 * K / phasors.omega.mean()), given.M])
    size = np.concatenate([size, [np.sqrt(given.M2[i, i] * given.M2[j, j]) for i, j in pairs]])
    start = np.concatenate([K, D, given.M, [given.M2[i, j] for i, j in pairs]])
    rows = 2 * phasors.q.size
    if rows < 2 * size.size:
        raise JointIdError("There are too few records to check the inertias by.")
    noise = spring_equations(phasors, inertia).noise.covariance[:, 0]
    free = np.arange(start.size) < 2 * n
    fixed, cost_given, _ = _minimise(phasors, noise, start, size, free, n)
    found, cost, information = _minimise(phasors, noise, fixed, size, np.ones_like(free), n)
    misfit = 2 * cost / (rows - size.size)
    covariance = covariance_of(information / max(1.0, misfit))
    error = np.sqrt(np.diag(covariance)) * size
    return InertiaCheck(
        names=(
            *(f"J_m{j + 1}" for j in range(n)),
            *(f"J_a{i + 1}" if i == j else f"J_{i + 1}{j + 1}" for i, j in pairs),
        ),
        given=start[2 * n :],
        found=found[2 * n :],
        standard_error=error[2 * n :],
        estimate=found[: 2 * n],
        misfit_given=2 * cost_given / (rows - 2 * n),
        misfit_found=misfit,
    )


def _minimise(
    phasors: Phasors, noise: Complexes, start: Floats, size: Floats, free: np.ndarray, n: int
) -> tuple[Floats, float, Floats]:
    """Levenberg-Marquardt on Σ rᴴV⁻¹r and the prior; parameters, cost, information."""
    prior = np.where(np.arange(start.size) < 2 * n, 0.0, 1 / _PRIOR**2)[free]
    origin, p, damping = start, start.copy(), 1e-3
    columns = np.flatnonzero(free)

    def whitened(at: Floats, root: Complexes) -> Floats:
        r = (root @ _balance(phasors, at, n)[0][..., None])[..., 0].ravel()
        return np.concatenate([r.real, r.imag])

    def total(at: Floats, row: Floats) -> float:
        return float(2 * row @ row + prior @ ((at - origin)[free] / size[free]) ** 2)

    information = np.eye(columns.size)
    for _ in range(_PASSES):
        root = _whitening(phasors, noise, p, n)
        row = whitened(p, root)
        J = np.empty((row.size, columns.size))
        for k, column in enumerate(columns):
            step = np.zeros(p.size)
            step[column] = 1e-6 * size[column]
            J[:, k] = (whitened(p + step, root) - whitened(p - step, root)) / 2e-6
        information = 2 * J.T @ J + np.diag(prior)
        gradient = 2 * J.T @ row + prior * ((p - origin)[free] / size[free])
        before = total(p, row)
        while damping < 1e8:
            scaled = information + damping * np.diag(np.diag(information))
            trial = p.copy()
            trial[free] -= size[free] * np.linalg.solve(scaled, gradient)
            if np.all(trial[:n] > 0) and _is_inertia(trial, n):
                after = total(trial, whitened(trial, root))
                if after <= before:
                    break
            damping *= 10
        else:
            break
        p, damping = trial, max(damping / 10, _LEAST_DAMPING)
        if before - after < 1e-6 * max(after, 1.0):
            break
    row = whitened(p, _whitening(phasors, noise, p, n))
    return p, float(row @ row), information


def _is_inertia(p: Floats, n: int) -> bool:
    return bool(np.all(p[2 * n : 3 * n] > 0) and np.linalg.eigvalsh(_arm(p, n))[0] > 0)


def _arm(p: Floats, n: int) -> Floats:
    M2 = np.zeros((n, n))
    M2[np.triu_indices(n)] = p[3 * n :]
    return M2 + np.triu(M2, 1).T


def _balance(phasors: Phasors, p: Floats, n: int) -> tuple[Complexes, Complexes]:
    """Torque left over (r, n), and the matrix E (r, n, 2n) with which noise enters it."""
    s = 1j * phasors.omega
    spring = p[:n] + s[:, None] * p[n : 2 * n]
    s2 = (s * s)[:, None, None]
    S = np.linalg.inv(_arm(p, n)) + s2 * np.eye(n) / spring[:, None]
    Z = s2 * (np.diag(p[2 * n : 3 * n]) + np.linalg.inv(S))
    E = np.concatenate([-Z, np.broadcast_to(np.eye(n), Z.shape)], axis=2)
    return (E @ phasors.z[..., None])[..., 0], E


def _whitening(phasors: Phasors, noise: Complexes, p: Floats, n: int) -> Complexes:
    E = _balance(phasors, p, n)[1]
    V = E @ noise @ E.conj().swapaxes(1, 2)
    return whitener(V)
