"""A grey-box fit of K and D to the transfer matrix, by scipy.optimize.least_squares.

Its best use: the model in closed form for two joints, all frequencies at once; logarithms of K and D as
parameters, so that they stay positive and are alike in size; bounds; columns scaled by the Jacobian; and
a choice of three weights of H. A default use is included as well: K and D as parameters, default
settings.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from jointid import Inertia, SineRecord, TransferMatrix, estimate_transfer_matrix, extract_phasors

Weight = Literal["plain", "size", "noise"]
SPAN = 1e3
"""Bounds lie this factor below and above the start."""


class Answer(NamedTuple):
    p: np.ndarray
    """K1, K2, D1, D2."""
    cost: float


def response(p: np.ndarray, omega: np.ndarray, inertia: Inertia) -> np.ndarray:
    """H of two joints, (f, 4) in the order 11, 12, 21, 22, in closed form: H = (S⁻¹ + M)⁻¹."""
    s = 1j * omega
    arm = np.linalg.inv(inertia.M2)
    S1 = arm[0, 0] + s**2 / (p[0] + s * p[2])
    S2 = arm[1, 1] + s**2 / (p[1] + s * p[3])
    c = arm[0, 1]
    size = S1 * S2 - c**2
    a, b, d = S2 / size + inertia.M[0], -c / size, S1 / size + inertia.M[1]
    determinant = a * d - b * b
    return np.stack([d, -b, -b, a], axis=1) / determinant[:, None]


def measured(records: tuple[SineRecord, ...]) -> TransferMatrix:
    """H from the records; a fit to H needs no harmonics, so none are asked for."""
    return estimate_transfer_matrix(extract_phasors(records, harmonics=1))


def fit(H: TransferMatrix, inertia: Inertia, start: np.ndarray, weight: Weight) -> Answer:
    """The best use. ``weight``: H as it is, by its size, or by jointid's own estimate of its noise."""
    flat = H.H.reshape(-1, 4)
    scale = {
        "plain": np.full(flat.shape, np.abs(flat).max()),
        "size": np.abs(flat),
        "noise": H.standard_deviation.reshape(-1, 4),
    }[weight]

    def residual(x: np.ndarray) -> np.ndarray:
        return ((response(np.exp(x), H.omega, inertia) - flat) / scale).ravel().view(float)

    x0, span = np.log(start), np.log(SPAN)
    found = least_squares(
        residual,
        x0,
        bounds=(x0 - span, x0 + span),
        x_scale="jac",
        ftol=1e-12,
        xtol=1e-12,
        gtol=1e-12,
        max_nfev=300,
    )
    return Answer(np.exp(found.x), float(found.cost))


def fit_by_default(H: TransferMatrix, inertia: Inertia, start: np.ndarray) -> Answer:
    """The obvious first attempt: K and D as parameters, no bounds, default settings."""
    flat = H.H.reshape(-1, 4)

    def residual(p: np.ndarray) -> np.ndarray:
        return (response(p, H.omega, inertia) - flat).ravel().view(float)

    with np.errstate(all="ignore"):
        try:
            found = least_squares(residual, start)
        except ValueError:  # it ran to where H is not finite
            return Answer(np.full(4, np.nan), np.inf)
    return Answer(found.x, float(found.cost))
