"""Residuals in the orthogonal complement of the free waveforms: the projection of large systems.

A waveform is a torque at one motor, with amplitudes that are unknown. A basis Q of the complement of
every motor's waveforms depends on no parameter, and the likelihood over all amplitudes is that of Qᵀr
with its covariance Qᵀ V Q (restricted maximum likelihood; Harville, Journal of the American Statistical
Association 72, 1977). With many motors it is far smaller than r, and than their waveforms together.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import qr, solve_triangular
from scipy.linalg.lapack import dpotrf, dpotri

from jointid.arrays import Complexes, Floats

DEPENDENT = 1e-11
"""Square of the sine of the angle to the others below which a column is one of them."""
_RIDGE = 1e-14
"""Added to a covariance of unit diagonal: its rounding must not make it singular."""


@dataclass(frozen=True, eq=False)
class Waveforms:
    """Unknown friction of every joint in one record, at H bins."""

    free: Sequence[Complexes]
    """Torques of any size, each (H, k)."""
    bounded: Sequence[Complexes]
    """Those of known size, each (H, c) per unit of their standard deviation."""
    known: np.ndarray
    """Which bins are equations of which joint, shape (H, n)."""

    @property
    def count(self) -> int:
        """Number of free waveforms; their rank may be smaller."""
        return sum(each.shape[1] for each in self.free)

    @cached_property
    def basis(self) -> Basis:
        """Basis of the complement of the free waveforms: the same in all fits."""
        n = len(self.free)
        parts, freed, spread = [], np.zeros(n), []
        for j, (shapes, others) in enumerate(zip(self.free, self.bounded, strict=True)):
            used = np.flatnonzero(self.known[:, j])
            left = np.eye(2 * used.size)
            if used.size and shapes.shape[1]:
                rows = np.concatenate([shapes[used].real, shapes[used].imag])
                rows /= np.maximum(np.linalg.norm(rows, axis=0), np.finfo(float).tiny)
                Q, R, _ = qr(rows, pivoting=True, check_finite=False)
                freed[j] = np.count_nonzero(np.abs(np.diag(R)) > np.sqrt(DEPENDENT))
                left = Q[:, int(freed[j]) :].T
            part = np.zeros((len(left), len(self.known)), complex)
            part[:, used] = left[:, : used.size] + 1j * left[:, used.size :]
            parts.append(part)
            sizes = left @ np.concatenate([others[used].real, others[used].imag])
            spread.append(2 * sizes @ sizes.T)
        joint = np.repeat(np.arange(n), [len(part) for part in parts])
        return Basis(np.concatenate(parts), joint, freed, tuple(spread))


@dataclass(frozen=True, eq=False)
class Basis:
    """Orthonormal torques of one record, orthogonal to all free waveforms."""

    torques: Complexes
    """Rows of its bins, shape (C, H); as real rows [Re, Im] they are orthonormal."""
    joint: np.ndarray
    """Joint of each, ascending, shape (C,)."""
    freed: Floats
    """Rank of the waveforms of every joint, shape (n,)."""
    bounded: tuple[Floats, ...]
    """Covariance of its waveforms of known size, in its torques, each (c, c)."""

    def sized(self, sizes: Floats) -> Basis:
        """The basis with bounded waveforms of other standard deviations, shape (n,)."""
        return replace(
            self, bounded=tuple(s * s * each for s, each in zip(sizes, self.bounded, strict=True))
        )

    def of_joints(self) -> Iterator[slice]:
        """Place of every joint's torques."""
        edges = np.searchsorted(self.joint, np.arange(self.freed.size + 1)).tolist()
        return itertools.starmap(slice, itertools.pairwise(edges))

    def moved(self, factor: Complexes) -> Basis:
        """Basis for the waveforms times phase factors, shape (H, n)."""
        return replace(self, torques=self.torques * factor.T[self.joint, : self.torques.shape[1]])

    def covariance(self, V: Complexes) -> Floats:
        """Upper triangle of twice the covariance (C, C) of real rows, for that of bins, (H, n, n)."""
        S = np.zeros((self.joint.size, self.joint.size))
        between = np.ascontiguousarray(V.transpose(1, 2, 0)[..., : self.torques.shape[1]])
        for own, row, bounded in zip(self.of_joints(), between, self.bounded, strict=True):
            later = row[self.joint[own.start :]] * self.torques[own.start :]
            S[own, own.start :] = self.torques[own].view(float) @ later.view(float).T
            S[own, own] += bounded
        return S


@dataclass(frozen=True, eq=False)
class Complement:
    """Whitened coordinates of residuals in the bases of all records."""

    V: Complexes
    """Covariance of the residual, shape (r, H, n, n)."""
    bases: tuple[Basis, ...]
    roots: tuple[Floats, ...]
    """Upper Cholesky factors of the covariances, each (C, C)."""

    @classmethod
    def of(cls, bases: tuple[Basis, ...], V: Complexes) -> Complement:
        """Coordinates of unit variance for the covariance V, shape (r, H, n, n)."""
        roots = []
        for basis, own in zip(bases, V, strict=True):
            S = basis.covariance(own)
            S[np.diag_indices_from(S)] *= 1 + _RIDGE
            root, fault = dpotrf(S.T, lower=True, clean=False, overwrite_a=True)  # without a copy
            if fault:
                raise np.linalg.LinAlgError("a covariance is not positive definite")
            roots.append(root.T)
        return cls(V, bases, tuple(roots))

    def rows(self, values: Complexes) -> Floats:
        """Coordinates (r, C, c) of values (r, H, n, c), padded with zeros."""
        most = max(basis.joint.size for basis in self.bases)
        found = np.zeros((len(values), most, values.shape[3]))
        for place, basis, U, value in zip(found, self.bases, self.roots, values, strict=True):
            bins = np.ascontiguousarray(value[: basis.torques.shape[1]].transpose(1, 2, 0)).view(float)
            own = np.empty((basis.joint.size, values.shape[3]))
            for used, of_joint in zip(basis.of_joints(), bins, strict=True):
                own[used] = basis.torques[used].view(float) @ of_joint.T
            place[: len(own)] = solve_triangular(U, own, trans="T", check_finite=False)
        return found

    def weighted(self, rows: Floats) -> Complexes:
        """Values (r, H, n, c) over their covariance for their coordinates (r, C, c).

        That covariance contains the bounded waveforms; V times the result is the part by noise alone.
        """
        return self._values(rows, of_bounded=False)

    def bounded_friction(self, rows: Floats) -> Complexes:
        """Most likely bounded friction (r, H, n, c) for the coordinates of a residual, (r, C, c).

        Without its part in the free waveforms.
        """
        return self._values(rows, of_bounded=True)

    def _values(self, rows: Floats, *, of_bounded: bool) -> Complexes:
        found = np.zeros((*self.V.shape[:3], rows.shape[2]), complex)
        for place, basis, U, own in zip(found, self.bases, self.roots, rows, strict=True):
            solved = solve_triangular(U, own[: basis.joint.size], check_finite=False)
            for j, (used, bounded) in enumerate(zip(basis.of_joints(), basis.bounded, strict=True)):
                size = bounded @ solved[used] if of_bounded else solved[used]
                place[: basis.torques.shape[1], j] = basis.torques[used].T @ size
        return found

    def noise_left(self) -> Floats:
        """Degrees of freedom that noise keeps in its part of the residual, shape (r, n)."""
        left = np.zeros((len(self.bases), self.V.shape[2]))
        for place, basis, U in zip(left, self.bases, self.roots, strict=True):
            if not basis.joint.size:  # friction explains the whole record
                continue
            of_U = np.tril(dpotri(U.T, lower=True)[0])
            share = of_U + np.tril(of_U, -1).T
            for used, bounded in zip(basis.of_joints(), basis.bounded, strict=True):
                share[:, used] = share[:, used] @ bounded
            kept = np.eye(basis.joint.size) - share
            place[:] = np.bincount(basis.joint, (kept * kept.T).sum(axis=1), place.size)
        return left
