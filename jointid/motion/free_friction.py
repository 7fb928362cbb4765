"""Free friction waveforms around the reversals of the motors, projected out of the residual.

The waveforms are linear nuisance parameters, eliminated record by record by variable projection (Golub
and Pereyra, Inverse Problems 19, 2003). Where they fill most of a motion's equations, the few directions
that are left are kept instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve, qr

from jointid.arrays import Complexes, Floats
from jointid.small_matrices import inverse

_MANY = 48
"""Waveforms from which Cholesky's method pays for a call per record."""
_RIDGE = 1e-11
"""Added to the Gram matrix of unit columns: neighbouring hat functions are nearly dependent."""


@dataclass(frozen=True, eq=False)
class Waveforms:
    """Waveforms of a record, or padded with zeros of g records with similarly many."""

    shapes: Complexes
    """Shape (H, n, k) or (g, H, n, k)."""
    kept: bool = False
    """Whether these are an orthonormal basis of all that is not free."""

    @classmethod
    def fewest(cls, shapes: Complexes) -> Waveforms:
        """The waveforms (H, n, k), of one joint each, or the rest of the rows that are not zero."""
        H, n, k = shapes.shape
        bins = np.flatnonzero(np.any(shapes != 0, axis=(1, 2)))
        if k <= bins.size * n:
            return cls(shapes)
        columns = []
        for j in range(n):
            own = shapes[bins, j][:, np.any(shapes[:, j] != 0, axis=0)]
            own = np.concatenate([own.real, own.imag])
            own = own / np.linalg.norm(own, axis=0)
            Q, R, _ = qr(own, pivoting=True, check_finite=False)
            left = Q[:, np.count_nonzero(np.abs(np.diag(R)) > np.sqrt(_RIDGE)) :]
            column = np.zeros((H, n, left.shape[1]), complex)
            column[bins, j] = left[: bins.size] + 1j * left[bins.size :]
            columns.append(column)
        return cls(np.concatenate(columns, axis=2), kept=True)

    @property
    def count(self) -> int:
        """Number of free waveforms; their rank may be smaller."""
        found = int(np.any(self.shapes != 0, axis=(-3, -2)).sum())
        rows = 2 * self.shapes.shape[-2] * int(np.any(self.shapes != 0, axis=(-2, -1)).sum())
        return rows - found if self.kept else found


@dataclass(frozen=True, eq=False)
class FreeFriction:
    """Waveforms of all records, in groups of records with similarly many, to limit the padding."""

    groups: tuple[tuple[np.ndarray, Waveforms], ...]
    """Indices of the records, shape (g,), and their waveforms."""
    ends: tuple[np.ndarray, Complexes] | None = None
    """Indices of some records, shape (m,), and further columns, (m, H, n, k)."""

    @classmethod
    def of(cls, records: Sequence[Waveforms], H: int) -> FreeFriction:
        """Group the waveforms of the records, each with its own k and at most H harmonics."""
        counts = np.array([each.shapes.shape[2] for each in records], dtype=int)
        kept = np.array([each.kept for each in records])
        sizes = np.ceil(np.log2(np.maximum(counts, 1))).astype(int) + 64 * kept
        groups = []
        for size in np.unique(sizes[(counts > 0) | kept]).tolist():
            members = np.flatnonzero((sizes == size) & ((counts > 0) | kept))
            padded = np.zeros(
                (members.size, H, records[0].shapes.shape[1], counts[members].max()), complex
            )
            for place, member in zip(padded, members.tolist(), strict=True):
                own = records[member].shapes
                place[: own.shape[0], :, : own.shape[2]] = own
            groups.append((members, Waveforms(padded, bool(size >= 64))))
        return cls(tuple(groups))

    def with_columns(self, records: np.ndarray, columns: Complexes) -> FreeFriction:
        """Project columns (m, H, n, k) of some records (m,) out as well."""
        return replace(self, ends=(records, columns))

    def moved(self, factor: Complexes) -> FreeFriction:
        """The waveforms of the records times phase factors (r, H, n): at other times."""
        groups = tuple(
            (records, replace(each, shapes=each.shapes * factor[records][..., None]))
            for records, each in self.groups
        )
        return replace(self, groups=groups)

    @property
    def shapes(self) -> int:
        """Number of waveforms; their rank may be smaller."""
        return sum(waveforms.count for _, waveforms in self.groups)

    def projection(self, W: Complexes) -> Projection:
        """Return the projection for the whitening matrices W, shape (r, H, n, n)."""
        columns = tuple(_whitened(records, each, W) for records, each in self.groups)
        free = Projection(W, columns)
        if self.ends is None:
            return free
        records, shapes = self.ends
        rows = np.zeros((len(W), 2 * W.shape[1] * W.shape[2], shapes.shape[3]))
        rows[records] = real_rows(W[records] @ shapes)
        left, whole = free.rest(rows)[records], np.linalg.norm(rows[records], axis=1, keepdims=True)
        left *= np.linalg.norm(left, axis=1, keepdims=True) > np.sqrt(_RIDGE) * whole
        return Projection(W, (*columns, Columns.of(records, left)))


@dataclass(frozen=True, eq=False)
class Columns:
    """Whitened columns of unit length that the rows of some records are freed of, or reduced to."""

    records: np.ndarray
    free: Floats
    """Shape (g, m, k)."""
    length: Floats
    """Of each column before, shape (g, k)."""
    gram: Floats
    """Shape (g, k, k)."""
    kept: np.ndarray | None
    """Rows in use, (g, m), where these columns are all that is not free."""

    @classmethod
    def of(cls, records: np.ndarray, free: Floats, kept: np.ndarray | None = None) -> Columns:
        """Scale columns (g, m, k) to unit length, in place."""
        length = np.linalg.norm(free, axis=1)
        free /= np.where(length > 0, length, 1.0)[:, None]
        gram = free.swapaxes(1, 2) @ free + _RIDGE * np.eye(free.shape[2])
        return cls(records, free, np.asarray(length), np.asarray(gram), kept)

    @cached_property
    def _factors(self) -> list[tuple[Floats, bool]]:
        return [cho_factor(gram, lower=True, check_finite=False) for gram in self.gram]

    def _solved(self, right: Floats) -> Floats:
        if self.gram.shape[1] < _MANY:
            return np.asarray(np.linalg.solve(self.gram, right))
        pairs = zip(self._factors, right, strict=True)
        return np.asarray([cho_solve(factor, b, check_finite=False) for factor, b in pairs])

    def sizes(self, rows: Floats) -> Floats:
        """Least-squares amplitudes (g, k, c) of the columns in rows (g, m, c)."""
        return self._solved(self.free.swapaxes(1, 2) @ rows)

    def rest(self, rows: Floats) -> Floats:
        """Rows (g, m, c) without the free part."""
        part = self.free @ self.sizes(rows)
        return np.asarray(part if self.kept is not None else rows - part)

    def rank(self) -> float:
        """Effective degrees of freedom of the free part."""
        own = np.count_nonzero(self.length)
        if self.kept is not None:
            return float(np.count_nonzero(self.kept) - own)
        zeros = self.length.size - own
        inverses = np.linalg.inv(self.gram)
        return float(own - (_RIDGE * np.trace(inverses, axis1=1, axis2=2).sum() - zeros))

    def leverage(self) -> Floats:
        """Share of every row that is free, shape (g, m)."""
        share = (self.free * self._solved(self.free.swapaxes(1, 2)).swapaxes(1, 2)).sum(axis=2)
        return np.asarray(share if self.kept is None else self.kept - share)


@dataclass(frozen=True, eq=False)
class Projection:
    """Projection of whitened rows onto the complement of the free waveforms."""

    W: Complexes
    """Whitening matrices, shape (r, H, n, n)."""
    groups: tuple[Columns, ...]
    """Of different records, but for the last ones, which are orthogonal to the others."""

    def rest(self, rows: Floats) -> Floats:
        """Rows (r, 2Hn, c), as ``real_rows`` makes them, without their projection onto the waveforms."""
        if not self.groups:
            return rows
        left = rows.copy()
        for each in self.groups:
            left[each.records] = each.rest(left[each.records])
        return left

    def first_sizes(self, rows: Floats, count: int) -> Floats:
        """Amplitudes (r, count) of the first of the further columns fitted to rows (r, 2Hn, 1)."""
        found, ends = np.zeros((len(rows), count)), self.groups[-1]
        length = np.where(ends.length > 0, ends.length, np.inf)
        found[ends.records] = (ends.sizes(rows[ends.records])[..., 0] / length)[:, :count]
        return found

    def rank(self) -> int:
        """Effective degrees of freedom of the free friction: the trace of its projection."""
        return round(sum(each.rank() for each in self.groups))

    def rank_by_joint(self, n: int) -> Floats:
        """Effective degrees of freedom of the free friction of n joints in each record, shape (r, n)."""
        found = np.zeros((len(self.W), n))
        for each in self.groups:
            found[each.records] += each.leverage().reshape(len(each.records), -1, n).sum(axis=1)
        return found

    def explained(self, rows: Floats, harmonics: int) -> Complexes:
        """Free friction fitted to the rows (r, 2Hn, 1) in use, shape (r, H, n)."""
        free = (rows - self.rest(rows))[..., 0].reshape(len(rows), 2, harmonics, -1)
        return np.asarray((_inverse(self.W)[0] @ (free[:, 0] + 1j * free[:, 1])[..., None])[..., 0])


def real_rows(values: Complexes) -> Floats:
    """Complex (r, H, n, k) as real rows (r, 2Hn, k)."""
    r, H, n, k = values.shape
    flat = values.reshape(r, H * n, k)
    return np.concatenate([flat.real, flat.imag], axis=1)


def _whitened(records: np.ndarray, waveforms: Waveforms, W: Complexes) -> Columns:
    W, shapes = W[records], waveforms.shapes
    if not waveforms.kept:
        return Columns.of(records, real_rows(W @ shapes))
    # The complement of W F is W⁻ᴴ times the complement of F.
    W, used = _inverse(W)
    rows = real_rows(W.conj().swapaxes(2, 3) @ shapes)
    return Columns.of(records, rows, real_rows(used[..., None] * (1 + 1j))[..., 0])


def _inverse(W: Complexes) -> tuple[Complexes, np.ndarray]:
    """W⁻¹ of the rows in use, and which these are, shape (r, H, n)."""
    used = np.diagonal(W, axis1=2, axis2=3) != 0
    W = W + np.eye(W.shape[-1]) * ~used[..., None]
    return inverse(W) * (used[..., None] & used[..., None, :]), used
