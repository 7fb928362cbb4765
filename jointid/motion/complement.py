"""Residuals with unknown friction: the projection of large systems.

A waveform is a torque at one motor, with an amplitude that is unknown. A basis Q of the complement of a
motor's waveforms depends on no parameter, and the likelihood over all amplitudes is that of Qᵀr with its
covariance Qᵀ V Q (restricted maximum likelihood; Harville, Journal of the American Statistical
Association 72, 1977). For a motor that mostly rests it is far smaller than r. A motor with few waveforms
keeps its bins, whose noise is independent, and the waveforms are columns to be projected out.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.linalg import qr, solve_triangular
from scipy.linalg.lapack import dpotrf, dpotri

from jointid.arrays import Complexes, Floats
from jointid.small_matrices import whitener

DEPENDENT = 1e-11
"""Square of the sine of the angle to the others below which a column is one of them."""
_RIDGE = 1e-14
"""Added to a covariance of unit diagonal: its rounding must not make it singular."""
_FEW = 1 / 3
"""Waveforms over equations up to which a motor keeps its bins: projecting so many columns out takes as
many operations as the covariance of the rest and its Cholesky factor."""


@dataclass(frozen=True, eq=False)
class Waveforms:
    """Unknown friction of every joint in one record, at H bins."""

    free: Sequence[Complexes]
    """Torques of any size, each (H, k)."""
    bounded: Sequence[Complexes]
    """Those of known size, each (H, c) per unit of their standard deviation."""
    known: np.ndarray
    """Which bins are equations of which joint, shape (H, n)."""
    in_short_rests: Floats = field(default_factory=lambda: np.zeros(1))
    """Number of unknown torques that are in rests of few periods of the band, shape (n,)."""

    @property
    def count(self) -> int:
        """Number of free waveforms; their rank may be smaller."""
        return sum(each.shape[1] for each in self.free)

    @property
    def equations(self) -> np.ndarray:
        """Number of real equations of every joint, shape (n,)."""
        return np.asarray(2 * self.known.sum(axis=0))

    @cached_property
    def basis(self) -> Basis:
        """Basis of what the free waveforms leave: the same in all fits."""
        H, n = self.known.shape
        kept = np.zeros((H, n), bool)
        torques, columns, spread = [np.zeros((0, H), complex)], [np.zeros((0, H), complex)], []
        joint, of_column, freed = [], [], np.zeros(n)
        for j, (shapes, others) in enumerate(zip(self.free, self.bounded, strict=True)):
            used = np.flatnonzero(self.known[:, j])
            rows, sized = _real(shapes[used]), np.sqrt(2) * _real(others[used])
            kept[used, j] = rows.shape[1] + sized.shape[1] <= _FEW * len(rows)
            whole = bool(kept[:, j].any())
            within, left = _split(rows, whole=whole)
            freed[j] = len(within)
            if whole:
                within = np.concatenate([within, sized.T])
                left, sized = np.zeros((0, len(rows))), sized[:, :0]
                columns.append(_at(used, within, H))
                of_column += [(j, k >= freed[j]) for k in range(len(within))]
            torques.append(_at(used, left, H))
            joint += [j] * len(left)
            sizes = left @ sized
            spread.append(sizes @ sizes.T)
        of_joint, is_sized = np.array(of_column, dtype=int).reshape(-1, 2).T
        return Basis(
            np.concatenate(torques),
            np.array(joint, dtype=int),
            freed,
            tuple(spread),
            kept,
            np.concatenate(columns),
            of_joint,
            is_sized.astype(bool),
        )


def _split(rows: Floats, *, whole: bool) -> tuple[Floats, Floats]:
    """Orthonormal rows for the span of columns, and for all that is orthogonal to it.

    The latter are not computed for a motor that keeps its bins (``whole``).
    """
    if not rows.size:
        return rows.T, np.eye(len(rows))
    unit = rows / np.maximum(np.linalg.norm(rows, axis=0), np.finfo(float).tiny)
    Q, R, _ = qr(unit, mode="economic" if whole else "full", pivoting=True, check_finite=False)
    rank = np.count_nonzero(np.abs(np.diag(R)) > np.sqrt(DEPENDENT))
    return Q.T[:rank], Q.T[rank:]


def _real(columns: Complexes) -> Floats:
    """Complex columns (..., H, k) as real ones (..., 2H, k)."""
    return np.concatenate([columns.real, columns.imag], axis=-2)


def _at(used: np.ndarray, rows: Floats, H: int) -> Complexes:
    """Real rows of the bins used, (k, 2u), as complex ones of all bins, (k, H)."""
    found = np.zeros((len(rows), H), complex)
    found[:, used] = rows[:, : used.size] + 1j * rows[:, used.size :]
    return found


@dataclass(frozen=True, eq=False)
class Basis:
    """Torques of one record without its free friction, or together with a few columns of it."""

    torques: Complexes
    """Of motors that do not keep their bins: rows of its bins, shape (C, H), orthogonal to all free
    waveforms; as real rows [Re, Im] they are orthonormal."""
    joint: np.ndarray
    """Joint of each, ascending, shape (C,)."""
    freed: Floats
    """Rank of the free waveforms of every joint, shape (n,)."""
    bounded: tuple[Floats, ...]
    """Covariance of its waveforms of known size, in its torques, each (c, c)."""
    kept: np.ndarray
    """Which bins are equations of motors that keep them, shape (H, n)."""
    columns: Complexes
    """Their waveforms, as rows of the bins, shape (k, H)."""
    of_joint: np.ndarray
    """Joint of each, shape (k,)."""
    is_sized: np.ndarray
    """Whether the amplitude of each is known to a standard deviation of 1, or free; shape (k,)."""

    def sized(self, sizes: Floats) -> Basis:
        """The basis with bounded waveforms of other standard deviations, shape (n,)."""
        return replace(
            self,
            bounded=tuple(s * s * each for s, each in zip(sizes, self.bounded, strict=True)),
            columns=self.columns * np.where(self.is_sized, sizes[self.of_joint], 1.0)[:, None],
        )

    def with_levels(self, levels: Complexes) -> Basis:
        """The basis with further waveforms (H, n, c) of standard deviation 1."""
        levels = np.sqrt(2) * levels[: len(self.kept)]
        bounded, columns, joints = [], [self.columns], [self.of_joint]
        for j, (used, known) in enumerate(zip(self.of_joints(), self.bounded, strict=True)):
            own = levels[:, j]
            sizes = (self.torques[used].conj() @ own).real
            bounded.append(known + sizes @ sizes.T)
            if self.kept[:, j].any():
                columns.append((own * self.kept[:, j, None]).T)
                joints.append(np.full(own.shape[1], j))
        of_joint = np.concatenate(joints)
        is_sized = np.pad(self.is_sized, (0, of_joint.size - self.of_joint.size), constant_values=True)
        return replace(
            self,
            bounded=tuple(bounded),
            columns=np.concatenate(columns),
            of_joint=of_joint,
            is_sized=is_sized,
        )

    def of_joints(self) -> Iterator[slice]:
        """Place of every joint's torques."""
        edges = np.searchsorted(self.joint, np.arange(self.freed.size + 1)).tolist()
        return itertools.starmap(slice, itertools.pairwise(edges))

    def moved(self, factor: Complexes) -> Basis:
        """Basis for the waveforms times phase factors, shape (H, n)."""
        H = self.kept.shape[0]
        return replace(
            self,
            torques=self.torques * factor.T[self.joint, :H],
            columns=self.columns * factor.T[self.of_joint, :H],
        )

    def covariance(self, V: Complexes) -> Floats:
        """Upper triangle of twice the covariance (C, C) of real rows, for that of bins, (H, n, n)."""
        S = np.zeros((self.joint.size, self.joint.size))
        between = np.ascontiguousarray(V.transpose(1, 2, 0))
        for own, row, bounded in zip(self.of_joints(), between, self.bounded, strict=True):
            later = row[self.joint[own.start :]] * self.torques[own.start :]
            S[own, own.start :] = self.torques[own].view(float) @ later.view(float).T
            S[own, own] += bounded
        return S

    @cached_property
    def joints(self) -> np.ndarray:
        """Motors that keep their bins."""
        return np.flatnonzero(self.kept.any(axis=0))

    @cached_property
    def of_row(self) -> np.ndarray:
        """Joint of every coordinate: the real parts of the bins kept, their imaginary parts, torques."""
        return np.concatenate([np.tile(self.joints, 2 * len(self.kept)), self.joint])


@dataclass(frozen=True, eq=False)
class _Factor:
    """Square root of the covariance of one record, bins kept first."""

    whitener: Complexes
    """Of the bins kept, shape (H, a, a); zero where a bin is no equation."""
    through: Complexes
    """Expected values at all motors per value at the bins kept, shape (H, n, a)."""
    root: Floats
    """Upper Cholesky factor of the covariance of the torques given the bins kept, (C, C)."""

    @classmethod
    def of(cls, basis: Basis, V: Complexes) -> _Factor:
        H, a = len(basis.kept), basis.joints
        V, known = V[:H], basis.kept[:, a]
        both = known[:, :, None] & known[:, None]
        W = whitener(np.where(both, V[:, a[:, None], a], np.eye(a.size))) * known[:, :, None]
        through = (V[:, :, a] * known[:, None]) @ (W.conj().swapaxes(1, 2) @ W)
        S = basis.covariance(V - through @ V[:, a] if a.size else V)
        S[np.diag_indices_from(S)] *= 1 + _RIDGE
        root, fault = dpotrf(S.T, lower=True, clean=False, overwrite_a=True)  # without a copy
        if fault:
            raise np.linalg.LinAlgError("a covariance is not positive definite")
        return cls(W, through, root.T)

    def rows(self, basis: Basis, values: Complexes) -> Floats:
        """Coordinates of unit variance for values (H, n, c)."""
        values = values[: len(basis.kept)]
        of_kept = values[:, basis.joints]
        return self._joined(basis, self.whitener @ of_kept, values - self.through @ of_kept)

    def columns(self, basis: Basis) -> Floats:
        """The same for the columns of a basis, (C, k), each of one joint."""
        place, columns = np.searchsorted(basis.joints, basis.of_joint), basis.columns.T[:, None]
        own, through = self.whitener[:, :, place] * columns, self.through[:, :, place] * columns
        return self._joined(basis, own, -through)

    def _joined(self, basis: Basis, own: Complexes, given: Complexes) -> Floats:
        bins = np.ascontiguousarray(given.transpose(1, 2, 0)).view(float)
        torques = np.empty((basis.joint.size, own.shape[2]))
        for used, of_joint in zip(basis.of_joints(), bins, strict=True):
            torques[used] = basis.torques[used].view(float) @ of_joint.T
        torques = solve_triangular(self.root, torques, trans="T", check_finite=False)
        return np.concatenate([_real(own.reshape(-1, own.shape[2])), torques])

    def weighted(self, basis: Basis, rows: Floats) -> Complexes:
        """Values (H, n, c) over their covariance for coordinates (C, c)."""
        (H, n), a = basis.kept.shape, basis.joints
        real, imaginary, torques, _ = np.split(
            rows, np.cumsum([H * a.size, H * a.size, basis.joint.size])
        )
        solved = solve_triangular(self.root, torques, check_finite=False)
        found = np.zeros((H, n, rows.shape[1]), complex)
        for j, used in enumerate(basis.of_joints()):
            found[:, j] = basis.torques[used].T @ solved[used]
        own = (real + 1j * imaginary).reshape(H, a.size, rows.shape[1])
        by_torques = self.through.conj().swapaxes(1, 2) @ found
        found[:, a] += self.whitener.conj().swapaxes(1, 2) @ own - by_torques
        return found


@dataclass(frozen=True, eq=False)
class Complement:
    """Whitened coordinates of residuals in the bases of all records."""

    V: Complexes
    """Covariance of the residual, shape (r, H, n, n)."""
    bases: tuple[Basis, ...]
    factors: tuple[_Factor, ...]

    @classmethod
    def of(cls, bases: tuple[Basis, ...], V: Complexes) -> Complement:
        """Coordinates of unit variance for the covariance V, shape (r, H, n, n)."""
        return cls(V, bases, tuple(map(_Factor.of, bases, V)))

    @cached_property
    def coordinates(self) -> int:
        """Most coordinates of a record; in all rows, those of amplitudes of known size follow."""
        return max(len(basis.of_row) for basis in self.bases)

    @cached_property
    def _length(self) -> int:
        return self.coordinates + max(int(basis.is_sized.sum()) for basis in self.bases)

    def rows(self, values: Complexes) -> Floats:
        """Coordinates (r, C, c) of values (r, H, n, c), padded with zeros, beside the columns."""
        found = np.zeros((len(values), self._length, values.shape[3]))
        for place, basis, factor, own in zip(found, self.bases, self.factors, values, strict=True):
            place[: basis.of_row.size] = factor.rows(basis, own)
        return found

    def columns(self) -> Iterator[tuple[int, Floats]]:
        """Number and columns (C, k) of each record with some, to be projected out of its coordinates.

        An amplitude of known size is a measurement of zero.
        """
        for record, (basis, factor) in enumerate(zip(self.bases, self.factors, strict=True)):
            if count := basis.of_joint.size:
                found = np.zeros((self._length, count))
                found[: basis.of_row.size] = factor.columns(basis)
                sized = np.flatnonzero(basis.is_sized)
                found[self.coordinates + np.arange(sized.size), sized] = 1
                yield record, found

    def weighted(self, rows: Floats) -> Complexes:
        """Values (r, H, n, c) over their covariance for their coordinates (r, C, c).

        That covariance contains the bounded waveforms; V times the result is the part by noise alone.
        """
        found = np.zeros((*self.V.shape[:3], rows.shape[2]), complex)
        for place, basis, factor, own in zip(found, self.bases, self.factors, rows, strict=True):
            place[: len(basis.kept)] = factor.weighted(basis, own)
        return found

    def bounded_friction(self, rows: Floats) -> Complexes:
        """Most likely bounded friction (r, H, n) for the coordinates of a residual, (r, C).

        Without its part in the free waveforms.
        """
        weighted = self.weighted(rows[..., None])[..., 0]
        found = np.zeros_like(weighted)
        for place, basis, own in zip(found, self.bases, weighted, strict=True):
            place, own = place[: len(basis.kept)].T, own[: len(basis.kept)].T
            for j, (used, bounded) in enumerate(zip(basis.of_joints(), basis.bounded, strict=True)):
                torques = basis.torques[used]
                place[j] = torques.T @ (bounded @ (torques.conj() @ own[j]).real)
            sizes = (basis.columns.conj() * own[basis.of_joint]).sum(axis=1).real * basis.is_sized
            np.add.at(place, basis.of_joint, sizes[:, None] * basis.columns)
        return found

    def noise_left(self) -> Floats:
        """Degrees of freedom that noise keeps in its part of the residual, beside columns; (r, n)."""
        left = np.zeros((len(self.bases), self.V.shape[2]))
        for place, basis, factor in zip(left, self.bases, self.factors, strict=True):
            place += 2 * np.count_nonzero(basis.kept, axis=0)
            if not basis.joint.size:  # friction explains the whole record, or its motors keep their bins
                continue
            of_root = np.tril(dpotri(factor.root.T, lower=True)[0])
            share = of_root + np.tril(of_root, -1).T
            for used, bounded in zip(basis.of_joints(), basis.bounded, strict=True):
                share[:, used] = share[:, used] @ bounded
            kept = np.eye(basis.joint.size) - share
            place += np.bincount(basis.joint, (kept * kept.T).sum(axis=1), place.size)
        return left
