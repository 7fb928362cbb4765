"""Algebra of many small matrices: loops over the few joints, not over the many records.

LAPACK is called once per matrix; for a 2 × 2 one the call costs far more than the inverse, and several
BLAS threads only wait for each other.
"""

from contextlib import AbstractContextManager
from functools import cache
from typing import TypeVar

import numpy as np
from scipy.linalg.lapack import dtbtrs, ztbtrs
from threadpoolctl import ThreadpoolController

from jointid.arrays import Complexes, Floats

Numbers = TypeVar("Numbers", Complexes, Floats)

NO_EFFECT = 1e-60
"""Root of a diagonal element of a normal matrix below which its parameter has no effect (SI units)."""
INSEPARABLE = 1e-10
"""Smallest eigenvalue, of a normal matrix of unit diagonal, that determines a combination."""
_INVOLVED = 1e-3
"""Share of a parameter in an undetermined combination from which its variance is infinite."""
_LEAST_EIGENVALUE = 1e-15
"""Smallest eigenvalue of a matrix of unit diagonal in double precision."""
_ROUNDING = 1e-15
"""Rounding error of a sum of a few terms, over their size."""
_LEAST_PIVOT = 1e-14
"""Smallest pivot over its diagonal element; below it the difference is rounding."""


def inverse(A: Numbers) -> Numbers:
    """Inverse of matrices of shape (..., n, n). Raises numpy.linalg.LinAlgError when one is singular."""
    if A.shape[-1] > 2:
        return np.linalg.inv(A)  # type: ignore[return-value]
    if A.shape[-1] == 1:
        determinant, adjugate = A[..., 0, 0], np.ones_like(A)
    else:
        a, b, c, d = A[..., 0, 0], A[..., 0, 1], A[..., 1, 0], A[..., 1, 1]
        determinant, adjugate = a * d - b * c, np.empty_like(A)
        adjugate[..., 0, 0], adjugate[..., 0, 1] = d, -b
        adjugate[..., 1, 0], adjugate[..., 1, 1] = -c, a
    if not np.all(determinant):
        raise np.linalg.LinAlgError("Singular matrix")
    adjugate /= determinant[..., None, None]
    return adjugate


def whitener(V: Numbers) -> Numbers:
    """W with W V Wᴴ = I for covariances V of shape (..., n, n): L⁻¹ of V = L Lᴴ.

    In double precision, a direction of V below ``_LEAST_PIVOT`` of its diagonal equals zero or less. It
    counts as that much, so that a singular V has a whitener, too. Only a variance of zero has none: a
    diagonal element that is not positive raises numpy.linalg.LinAlgError.
    """
    n = V.shape[-1]
    W = np.zeros_like(V)
    L = np.zeros_like(V)
    for j in range(n):
        variance = V[..., j, j].real
        if not np.all(variance > 0):
            raise np.linalg.LinAlgError("A variance is not positive")
        pivot = variance - (np.abs(L[..., j, :j]) ** 2).sum(axis=-1)
        scale = 1 / np.sqrt(np.maximum(pivot, _LEAST_PIVOT * variance))
        for i in range(j + 1, n):
            below = V[..., i, j] - (L[..., i, :j] * L[..., j, :j].conj()).sum(axis=-1)
            L[..., i, j] = below * scale
        # Row j of L⁻¹ by forward substitution.
        W[..., j, j] = scale
        for i in range(j):
            W[..., j, i] = -scale * (L[..., j, i:j] * W[..., i:j, i]).sum(axis=-1)
    return W


def lifted(V: Complexes, E: Complexes, C: Complexes) -> Complexes:
    """V = E C Eᴴ (..., n, n) with every variance at least the rounding of its terms; changes V in place.

    Strongly correlated signals may cancel to zero, or by rounding to less.
    """
    variance = np.diagonal(C, axis1=-2, axis2=-1).real
    for j in range(V.shape[-1]):
        least = _ROUNDING * (np.abs(E[..., j, :]) ** 2 * variance).sum(axis=-1)
        V[..., j, j] += np.maximum(least - V[..., j, j].real, 0.0)
    return V


def root(V: Complexes) -> Complexes:
    """Matrix whose product with its conjugate transpose is the covariance V, (..., n, n).

    V may be singular. With it a variance is a sum of squares, which rounding cannot make negative.
    """
    size = np.sqrt(np.maximum(np.diagonal(V, axis1=-2, axis2=-1).real, 0.0))
    unit = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(V / (unit[..., :, None] * unit[..., None, :]))
    return np.asarray(size[..., None] * vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :])


def unit_diagonal(normal: Floats) -> tuple[np.ndarray, Floats, Floats]:
    """Scale a normal matrix, shape (P, P), to unit diagonal, without parameters that have no effect.

    Returns the mask of rows with a positive diagonal, shape (P,), p of them; the root of their diagonal,
    shape (p,); and their matrix over the outer product of these roots, shape (p, p).
    """
    size = np.sqrt(np.maximum(np.diag(normal), 0.0))
    seen = size > NO_EFFECT
    size = size[seen]
    return seen, size, np.asarray(normal[np.ix_(seen, seen)] / np.outer(size, size))


def positive_inverse(A: Floats) -> Floats:
    """Inverse of a symmetric positive matrix (P, P), such as the covariance of a normal matrix JᵀJ.

    A direction of size zero has an inverse as large as double precision allows; a row of zeros gives
    infinity, the variance of a parameter without any effect.
    """
    seen, size, scaled = unit_diagonal(A)
    values, vectors = np.linalg.eigh(scaled)
    least = _LEAST_EIGENVALUE * values.size
    inverted = np.diag(np.where(seen, 0.0, np.inf))
    inner = (vectors / np.maximum(values, least)) @ vectors.T
    inverted[np.ix_(seen, seen)] = inner / np.outer(size, size)
    return inverted


def determined_covariance(normal: Floats, prior: Floats | None = None) -> Floats:
    """Inverse of a normal matrix, shape (P, P); infinite variances for undetermined parameters.

    ``prior`` is the part of the matrix that does not come from data. A direction that it determines is
    determined, however much more accurate the others are.
    """
    seen, size, scaled = unit_diagonal(normal)
    covariance = np.zeros(normal.shape)
    covariance[~seen, ~seen] = np.inf
    values, vectors = np.linalg.eigh(scaled)
    known = values > INSEPARABLE
    if prior is not None and not known.all():
        weak = vectors / size[:, None]
        by_prior = np.einsum("ik,ij,jk->k", weak, prior[np.ix_(seen, seen)], weak)
        known |= (values > _LEAST_EIGENVALUE * values.size) & (by_prior > 0.5 * values)
    inner = (vectors[:, known] / values[known]) @ vectors[:, known].T
    unknown = np.any(np.abs(vectors[:, ~known]) > _INVOLVED, axis=1)
    inner[unknown, unknown] = np.inf
    covariance[np.ix_(seen, seen)] = inner / np.outer(size, size)
    return covariance


def finite_part(covariance: Floats) -> Floats:
    """Covariance, shape (P, P), of the determined parameters; zero for those of infinite variance."""
    finite = np.isfinite(np.diag(covariance))
    return np.where(np.outer(finite, finite), covariance, 0.0)


def one_thread() -> AbstractContextManager[object]:
    """Return a context in which BLAS uses one thread."""
    return _controller().limit(limits=1, user_api="blas")  # type: ignore[no-any-return]


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()


def decaying(decay: Floats | Complexes, drive: Numbers) -> Numbers:
    """z[k] = decay[k] z[k − 1] + drive[k] from zero; drives (n, N) or (n, N, c), decay (n, N) or (n, 1).

    As ``scipy.signal.lfilter``, whose import takes a third of a second.
    """
    solve = ztbtrs if np.iscomplexobj(drive) else dtbtrs
    band = np.ones((2, drive.shape[0] * drive.shape[1]), drive.dtype, order="F")
    kept = np.array(np.broadcast_to(decay, drive.shape[:2]))
    kept[:, 0] = 0
    band[1, :-1] = -kept.ravel()[1:]
    right = drive.reshape(band.shape[1], -1)
    return np.asarray(solve(band, right, uplo="L", diag="U")[0].reshape(drive.shape))
