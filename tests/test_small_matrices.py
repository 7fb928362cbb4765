"""Algebra of many small matrices: equal to LAPACK one at a time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jointid.motion.complement import Waveforms
from jointid.motion.free_friction import FreeFriction, real_rows
from jointid.small_matrices import (
    decaying,
    determined_covariance,
    finite_part,
    inverse,
    lifted,
    positive_inverse,
    root,
    whitener,
)


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
def test_a_singular_matrix_is_refused(n: int) -> None:
    with pytest.raises(np.linalg.LinAlgError):
        inverse(np.zeros((2, n, n)))
    with pytest.raises(np.linalg.LinAlgError):
        whitener(-np.eye(n)[None] + 0j)


@pytest.mark.parametrize("bounded", [0, 1])
@given(seed=st.integers(0, 2**32 - 1))
def test_free_shapes_of_any_number_are_projected_out(seed: int, bounded: int) -> None:
    """What is left is orthogonal to every shape in units of noise; records without shapes keep all.

    So it is as columns and, with shapes of bounded size beside them, in the complement.
    """
    rng = np.random.default_rng(seed)
    r, H, n, k = 4, 7, 3, 2
    counts = rng.integers(0, k + 1, (r, n))
    counts[0] = k
    shown = [
        [rng.standard_normal((H, c)) + 1j * rng.standard_normal((H, c)) for c in each] for each in counts
    ]
    mixing = np.array([[2.0, 0, 0], [0.3j, 0.5, 0], [1.0, -0.2, 1.5]])
    W = np.broadcast_to(mixing, (r, H, n, n)).astype(complex)
    V = np.linalg.inv(W.conj().swapaxes(2, 3) @ W)
    others, every = [np.zeros((H, bounded), complex)] * n, np.ones((H, n), bool)
    free = FreeFriction.of(
        [Waveforms(own, others, every) for own in shown],
        np.zeros((r, n)),
        np.zeros((r, H, n, 0), complex),
    )
    assert bool(free.bases) == bool(bounded)
    projection = free.projection(W, V)
    values = rng.standard_normal((r, H, n, 3)) + 1j * rng.standard_normal((r, H, n, 3))
    left, whole = projection.rows(values), real_rows(W @ values)
    kept = projection.whitened(left)
    shapes = np.zeros((r, H, n, n * k), complex)
    for record, each in enumerate(shown):
        for j, own in enumerate(each):
            shapes[record, :, j, j * k : j * k + own.shape[1]] = own
    within = np.einsum("rmk,rmc->rkc", real_rows(W @ shapes), real_rows(kept))
    assert np.allclose(within, 0, atol=1e-6)
    assert np.allclose((left**2).sum(axis=1), (np.abs(kept) ** 2).sum(axis=(1, 2)), rtol=1e-9)
    assert np.allclose(real_rows(kept)[counts.sum(axis=1) == 0], whole[counts.sum(axis=1) == 0])
    assert projection.rank() == counts.sum()
    mixture = shapes @ rng.standard_normal((r, 1, n * k, 1))
    assert np.allclose(projection.explained(mixture), mixture[..., 0], atol=1e-6)


def test_waveforms_of_known_size_are_noise() -> None:
    """The coordinates of a residual with them are those of its whole covariance."""
    rng = np.random.default_rng(5)
    H, n = 6, 3
    V = np.eye(n) * np.array([1.0, 4.0, 0.25]) + 0.1 * np.ones((H, n, n)) + 0j
    bounded = [rng.standard_normal((H, 2)) + 1j * rng.standard_normal((H, 2)) for _ in range(n)]
    none = [np.zeros((H, 0), complex)] * n
    free = FreeFriction.of(
        [Waveforms(none, bounded, np.ones((H, n), bool))],
        np.ones((1, n)),
        np.zeros((1, H, n, 0), complex),
    )
    r = rng.standard_normal((1, H, n, 1)) + 1j * rng.standard_normal((1, H, n, 1))
    rows = free.projection(whitener(V[None]), V[None]).rows(r)
    whole = np.zeros((2 * H * n, 2 * H * n))  # twice the covariance of the real rows
    for h in range(H):
        place = np.arange(n) + h * n
        whole[np.ix_(place, place)] = whole[np.ix_(place + H * n, place + H * n)] = V[h].real
    for j, shapes in enumerate(bounded):
        own = np.zeros((1, H, n, 2), complex)
        own[0, :, j] = shapes
        columns = real_rows(own)[0]
        whole += 2 * columns @ columns.T
    real = real_rows(r)[0, :, 0]
    np.testing.assert_allclose((rows**2).sum(), real @ np.linalg.solve(whole, real), rtol=1e-9)


@pytest.mark.parametrize("count", [0, 1, 5])  # the third motor does not keep its bins
def test_levels_are_waveforms_of_standard_deviation_one(count: int) -> None:
    """Beside as many free waveforms, and with a torque scale and its derivative."""
    rng, H, n = np.random.default_rng(6), 6, 2

    def shapes(columns: int) -> list[np.ndarray]:
        each = (n, H, columns)
        return list(rng.standard_normal(each) + 1j * rng.standard_normal(each))

    V = np.eye(n) * np.array([1.0, 4.0]) + 0.1 * np.ones((1, H, n, n)) + 0j
    free, levels = shapes(count), shapes(2)
    none, known = [each[:, :0] for each in levels], np.ones((H, n), bool)
    results, r = [], rng.standard_normal((1, H, n, 1)) + 1j * rng.standard_normal((1, H, n, 1))
    for bounded, differing in ((levels, none), (none, levels)):
        record, own = Waveforms(free, bounded, known), np.stack(differing, axis=1)[None]
        plain = FreeFriction.of([record], np.ones((1, n)), own)

        def rows(second: float, plain: FreeFriction = plain) -> np.ndarray:
            return plain.scaled(np.array([1.0, second])).projection(whitener(V), V).rows(r)

        found = plain.scaled(np.array([1.0, 3.0]))
        projection = found.projection(whitener(V), V)
        left, complement = projection.rows(r), projection.complement
        torque = (complement.bounded_friction if complement else found.of_known_size)(left[..., 0])
        by_scale = projection.rows((torque * [0.0, 1 / 3.0])[..., None])
        slope = ((rows(3.001) ** 2).sum() - (rows(2.999) ** 2).sum()) / 0.002
        assert -2 * (left * by_scale).sum() == pytest.approx(slope, rel=1e-5)
        results.append([(left**2).sum(), projection.rank(), *projection.explained(r).ravel()])
    np.testing.assert_allclose(results[0], results[1], rtol=1e-9)


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


def test_indistinguishable_parameters_have_huge_variances() -> None:
    J = np.array([[1.0, 1.0], [2.0, 2.0]])
    assert np.all(np.diag(positive_inverse(J.T @ J)) > 1e12)


def test_a_prior_determines_what_much_better_data_leave_open() -> None:
    J, prior = np.array([[1e6, -1e6], [3e6, -3e6]]), np.diag([0.0, 1.0])
    assert np.isinf(np.diag(determined_covariance(J.T @ J + prior))).all()
    covariance = determined_covariance(J.T @ J + prior, prior)
    np.testing.assert_allclose(covariance, np.ones((2, 2)), rtol=1e-2)
    assert np.isinf(np.diag(determined_covariance(J.T @ J, 0 * prior))).all()


def test_a_combination_is_undetermined_from_ten_digits_on() -> None:
    """J = [a + b, ε (a − b)]: the difference of the two parameters has the variance 1 / ε²."""
    for eps, finite in ((0.8e-5, True), (0.6e-5, False)):  # 2 ε² is the smallest eigenvalue
        J = np.array([[1.0, 1.0, 0.0], [eps, -eps, 0.0], [0.0, 0.0, 2.0]])
        covariance = determined_covariance(J.T @ J)
        assert np.isfinite(covariance[0, 0]) == np.isfinite(covariance[1, 1]) == finite
        assert covariance[2, 2] == pytest.approx(0.25)
        known = finite_part(covariance)
        assert np.all(np.isfinite(known))
        assert known[2, 2] == pytest.approx(0.25)
        assert known[0, 0] == pytest.approx(0.25 / eps**2 if finite else 0.0, rel=1e-5)


def test_a_small_share_of_an_undetermined_combination_is_determined() -> None:
    """The third parameter takes part in it by 1e-4, which is less than a per mille."""
    for share, finite in ((1e-4, True), (2e-3, False)):
        unseen = np.array([1.0, -1.0, share * np.sqrt(2)])
        unseen /= np.linalg.norm(unseen)
        covariance = determined_covariance(np.eye(3) - np.outer(unseen, unseen))
        assert np.isinf(covariance[0, 0])
        assert np.isinf(covariance[1, 1])
        assert np.isfinite(covariance[2, 2]) == finite


@pytest.mark.parametrize("kind", [float, complex])
def test_a_decay_is_the_recursion(kind: type) -> None:
    rng = np.random.default_rng(1)
    drive = rng.standard_normal((2, 6)).astype(kind) * (1 + 0.5j if kind is complex else 1)
    for decay in (rng.uniform(-0.9, 0.9, (2, 6)), np.array([[0.5], [-0.8]])):
        expected, z = np.zeros_like(drive), np.zeros(2, kind)
        for k, kept in enumerate(np.broadcast_to(decay, drive.shape).T):
            z = expected[:, k] = kept * z + drive[:, k]
        np.testing.assert_allclose(decaying(decay, drive), expected, rtol=1e-12)
