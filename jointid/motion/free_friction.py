"""Free friction waveforms around the reversals of the motors, projected out of the residual.

The waveforms are linear nuisance parameters, eliminated record by record by variable projection (Golub
and Pereyra, Inverse Problems 19, 2003).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from jointid.arrays import Complexes, Floats
from jointid.small_matrices import inverse

_MANY = 48
"""Waveforms from which Cholesky's method pays for a call per record."""
_RIDGE = 1e-11
"""Added to the Gram matrix of unit columns: neighbouring hat functions are nearly dependent."""


@dataclass(frozen=True, eq=False)
class FreeFriction:
    """Waveforms of all records, in groups of records with similarly many, to limit the padding."""

    groups: tuple[tuple[np.ndarray, Complexes], ...]
    """Indices of the records, shape (g,), and their waveforms, (g, H, n, k), padded with zeros."""
    ends: tuple[np.ndarray, Complexes] | None = None
    """Indices of some records, shape (m,), and further columns, (m, H, n, k)."""

    @classmethod
    def of(cls, records: Sequence[Complexes], H: int) -> FreeFriction:
        """Group the waveforms (H', n, k) of the records, each with its own k and at most H harmonics."""
        counts = np.array([each.shape[2] for each in records], dtype=int)
        sizes = np.ceil(np.log2(np.maximum(counts, 1))).astype(int)
        groups = []
        for size in np.unique(sizes[counts > 0]).tolist():
            members = np.flatnonzero((sizes == size) & (counts > 0))
            padded = np.zeros((members.size, H, records[0].shape[1], counts[members].max()), complex)
            for place, member in zip(padded, members.tolist(), strict=True):
                own = records[member]
                place[: own.shape[0], :, : own.shape[2]] = own
            groups.append((members, padded))
        return cls(tuple(groups))

    def with_columns(self, records: np.ndarray, columns: Complexes) -> FreeFriction:
        """Project columns (m, H, n, k) of some records (m,) out as well."""
        return replace(self, ends=(records, columns))

    def moved(self, factor: Complexes) -> FreeFriction:
        """The waveforms of the records times phase factors (r, H, n): at other times."""
        return replace(self, groups=tuple((k, each * factor[k][..., None]) for k, each in self.groups))

    @property
    def shapes(self) -> int:
        """Number of waveforms; their rank may be smaller."""
        return sum(int(np.any(each != 0, axis=(1, 2)).sum()) for _, each in self.groups)

    def projection(self, W: Complexes) -> Projection:
        """Return the projection for the whitening matrices W, shape (r, H, n, n)."""
        columns = tuple(Columns.of(k, real_rows(W[k] @ each)) for k, each in self.groups)
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
    """Whitened columns of unit length that the rows of some records are freed of."""

    records: np.ndarray
    free: Floats
    """Shape (g, m, k)."""
    length: Floats
    """Of each column before, shape (g, k)."""
    gram: Floats
    """Shape (g, k, k)."""

    @classmethod
    def of(cls, records: np.ndarray, free: Floats) -> Columns:
        """Scale columns (g, m, k) to unit length, in place."""
        length = np.linalg.norm(free, axis=1)
        free /= np.where(length > 0, length, 1.0)[:, None]
        gram = free.swapaxes(1, 2) @ free + _RIDGE * np.eye(free.shape[2])
        return cls(records, free, np.asarray(length), np.asarray(gram))

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
        return np.asarray(rows - self.free @ self.sizes(rows))

    def rank(self) -> float:
        """Effective degrees of freedom of the free part."""
        own = np.count_nonzero(self.length)
        zeros = self.length.size - own
        inverses = np.linalg.inv(self.gram)
        return float(own - (_RIDGE * np.trace(inverses, axis1=1, axis2=2).sum() - zeros))

    def leverage(self) -> Floats:
        """Share of every row that is free, shape (g, m)."""
        solved = self._solved(self.free.swapaxes(1, 2)).swapaxes(1, 2)
        return np.asarray((self.free * solved).sum(axis=2))


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
        used = np.diagonal(self.W, axis1=2, axis2=3) != 0
        back = inverse(self.W + np.eye(self.W.shape[-1]) * ~used[..., None])
        found = (back @ (free[:, 0] + 1j * free[:, 1])[..., None])[..., 0]
        return np.asarray(np.where(used, found, 0))


def real_rows(values: Complexes) -> Floats:
    """Complex (r, H, n, k) as real rows (r, 2Hn, k)."""
    r, H, n, k = values.shape
    flat = values.reshape(r, H * n, k)
    return np.concatenate([flat.real, flat.imag], axis=1)
