"""Algebra of many small matrices: loops over the few joints, not over the many records.

LAPACK is called once per matrix; for a 2 × 2 one the call costs far more than the inverse, and several
BLAS threads only wait for each other.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import cache
from typing import TypeVar

import numpy as np
from threadpoolctl import ThreadpoolController

from jointid.arrays import Complexes, Floats

Numbers = TypeVar("Numbers", Complexes, Floats)


def inverse(A: Numbers) -> Numbers:
    """Inverse of matrices of shape (..., n, n).

    Raises
    ------
    numpy.linalg.LinAlgError
        When one is singular.
    """
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


def whitener(V: Complexes) -> Complexes:
    """W with W V Wᴴ = I for Hermitian positive definite V of shape (..., n, n): L⁻¹ of V = L Lᴴ.

    Raises
    ------
    numpy.linalg.LinAlgError
        When one is not positive definite.
    """
    n = V.shape[-1]
    W = np.zeros_like(V)
    L = np.zeros_like(V)
    for j in range(n):
        pivot = V[..., j, j].real - (np.abs(L[..., j, :j]) ** 2).sum(axis=-1)
        if not np.all(pivot > 0):
            raise np.linalg.LinAlgError("Matrix is not positive definite")
        scale = 1 / np.sqrt(pivot)
        for i in range(j + 1, n):
            below = V[..., i, j] - (L[..., i, :j] * L[..., j, :j].conj()).sum(axis=-1)
            L[..., i, j] = below * scale
        # Row j of L⁻¹ by forward substitution.
        W[..., j, j] = scale
        for i in range(j):
            W[..., j, i] = -scale * (L[..., j, i:j] * W[..., i:j, i]).sum(axis=-1)
    return W


def unit_diagonal(normal: Floats) -> tuple[np.ndarray, Floats, Floats]:
    """Scale a normal matrix, shape (P, P), to unit diagonal, without its zero rows and columns.

    Returns
    -------
    seen : ndarray of bool, shape (P,)
        Rows with a positive diagonal, p of them.
    size : ndarray, shape (p,)
        Root of their diagonal.
    scaled : ndarray, shape (p, p)
        Their matrix over the outer product of ``size``.
    """
    size = np.sqrt(np.diag(normal))
    seen = size > 0
    size = size[seen]
    return seen, size, np.asarray(normal[np.ix_(seen, seen)] / np.outer(size, size))


def one_thread() -> AbstractContextManager[object]:
    """Return a context in which BLAS uses one thread."""
    return _controller().limit(limits=1, user_api="blas")  # type: ignore[no-any-return]


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()
