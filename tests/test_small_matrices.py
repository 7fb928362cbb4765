"""Many small matrices at once: the same as LAPACK, one at a time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jointid.motion.free_friction import FreeFriction, real_rows
from jointid.small_matrices import inverse, lifted, positive_inverse, root, whitener


def stack(n: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.standard_normal((3, 5, n, n)) + 1j * rng.standard_normal((3, 5, n, n))


@given(n=st.integers(1, 4), seed=st.integers(0, 2**32 - 1))
def test_inverse_and_whitener(n: int, seed: int) -> None:
    A = stack(n, seed) + 3 * np.eye(n)
    assert np.allclose(inverse(A) @ A, np.eye(n), atol=1e-8)
    V = A @ A.conj().swapaxes(2, 3)
    W = whitener(V)
    assert np.allclose(W @ V @ W.conj().swapaxes(2, 3), np.eye(n), atol=1e-8)
    assert np.allclose(W, np.linalg.inv(np.linalg.cholesky(V)), atol=1e-8)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_what_cannot_be_inverted_is_refused(n: int) -> None:
    with pytest.raises(np.linalg.LinAlgError):
        inverse(np.zeros((2, n, n)))
    with pytest.raises(np.linalg.LinAlgError):
        whitener(-np.eye(n)[None] + 0j)


@given(seed=st.integers(0, 2**32 - 1))
def test_free_shapes_are_taken_out_whatever_their_number(seed: int) -> None:
    """What is left is orthogonal to every shape in units of noise; records without shapes keep all."""
    rng = np.random.default_rng(seed)
    r, H, n, k = 6, 7, 2, 5
    shapes = rng.standard_normal((r, H, n, k)) + 1j * rng.standard_normal((r, H, n, k))
    counts = rng.integers(0, k + 1, r)
    for record, count in enumerate(counts):
        shapes[record][..., count:] = 0
    W = np.broadcast_to(np.array([[2.0, 0], [0.3j, 0.5]]), (r, H, n, n)).astype(complex)
    shown = [each[..., :count] for each, count in zip(shapes, counts, strict=True)]
    free = FreeFriction.of(shown, H)
    rows = real_rows(rng.standard_normal((r, H, n, 3)) + 0j)
    projection = free.projection(W)
    left = projection.rest(rows)
    within = np.einsum("rmk,rmc->rkc", real_rows(W @ shapes), left)
    assert np.allclose(within, 0, atol=1e-6)
    assert np.array_equal(left[counts == 0], rows[counts == 0])
    assert projection.rank() == counts.sum()
    mixture = shapes @ rng.standard_normal((r, 1, k, 1))
    assert np.allclose(projection.explained(real_rows(W @ mixture), H), mixture[..., 0], atol=1e-6)


def test_a_singular_covariance_has_a_finite_whitener() -> None:
    direction = np.array([1.0, 2.0 - 1j, 1e6])
    V = np.outer(direction, direction.conj())[None]
    W = whitener(V)
    assert np.all(np.isfinite(W))
    np.testing.assert_allclose(W[0, 0] @ V[0] @ W[0, 0].conj(), 1.0)


def test_the_root_of_a_singular_covariance() -> None:
    direction = np.array([1e-6, 2.0 - 1j, 1e6])
    V = np.outer(direction, direction.conj())[None]
    found = root(V)[0]
    scale = np.outer(np.abs(direction), np.abs(direction))
    np.testing.assert_allclose(found @ found.conj().T / scale, V[0] / scale, atol=1e-12)


def test_signals_that_cancel_leave_a_positive_variance() -> None:
    C = np.ones((2, 2), complex)
    E = np.array([[1.0, -1.0]], complex)
    variance = lifted(E @ C @ E.conj().T, E, C)[0, 0].real
    assert 0 < variance < 1e-13


def test_a_parameter_without_effect_has_an_infinite_variance() -> None:
    J = np.array([[1.0, 0.0, 1e-9], [0.0, 0.0, 1e-9], [1.0, 0.0, 0.0]])
    covariance = positive_inverse(J.T @ J)
    assert np.isinf(covariance[1, 1])
    kept = np.ix_([0, 2], [0, 2])
    np.testing.assert_allclose(covariance[kept], np.linalg.inv((J.T @ J)[kept]), rtol=1e-9)


def test_parameters_that_cannot_be_told_apart_have_huge_variances() -> None:
    J = np.array([[1.0, 1.0], [2.0, 2.0]])
    assert np.all(np.diag(positive_inverse(J.T @ J)) > 1e12)
