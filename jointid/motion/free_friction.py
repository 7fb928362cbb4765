"""Free friction waveforms around the reversals of the motors, projected out of the residual.

The waveforms are linear nuisance parameters, eliminated record by record by variable projection (Golub
and Pereyra, Inverse Problems 19, 2003).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from jointid.arrays import Complexes, Floats

_MANY = 48
"""Waveforms from which Cholesky's method pays for a call per record."""
_RIDGE = 1e-11
"""Added to the Gram matrix of unit columns: neighbouring hat functions are nearly dependent."""


@dataclass(frozen=True, eq=False)
class FreeFriction:
    """Waveforms of all records, in groups of records with similarly many, to limit the padding."""

    groups: tuple[tuple[np.ndarray, Complexes], ...]
    """Indices of the records, shape (g,), and their waveforms, (g, H, n, k)."""

    @classmethod
    def of(cls, shapes: Sequence[Complexes]) -> FreeFriction:
        """Group the waveforms of the records, each of shape (H, n, k) with its own k."""
        counts = np.array([each.shape[2] for each in shapes], dtype=int)
        sizes = np.ceil(np.log2(np.maximum(counts, 1))).astype(int)
        groups = []
        for size in np.unique(sizes[counts > 0]).tolist():
            records = np.flatnonzero((sizes == size) & (counts > 0))
            padded = np.zeros((records.size, *shapes[0].shape[:2], counts[records].max()), complex)
            for place, record in zip(padded, records.tolist(), strict=True):
                place[..., : counts[record]] = shapes[record]
            groups.append((records, padded))
        return cls(tuple(groups))

    def with_columns(self, records: np.ndarray, columns: Complexes) -> FreeFriction:
        """Put columns (m, H, n, k) of some records (m,) before their waveforms."""
        place = np.full(1 + max(records.max(initial=0), *(g.max() for g, _ in self.groups), 0), -1)
        place[records] = np.arange(records.size)
        groups, left = [], np.ones(records.size, bool)
        for members, shapes in self.groups:
            own = place[members]
            before = np.where((own >= 0)[:, None, None, None], columns[own], 0)
            groups.append((members, np.concatenate([before, shapes], axis=3)))
            left[own[own >= 0]] = False
        if left.any():
            groups.append((records[left], columns[left]))
        return FreeFriction(tuple(groups))

    @property
    def shapes(self) -> int:
        """Number of waveforms; their rank may be smaller."""
        return sum(records.size * shapes.shape[3] for records, shapes in self.groups)

    def projection(self, W: Complexes) -> Projection:
        """Return the projection for the whitening matrices W, shape (r, H, n, n)."""
        return Projection(
            tuple((records, shapes, *_whitened(shapes, W[records])) for records, shapes in self.groups)
        )


@dataclass(frozen=True, eq=False)
class Projection:
    """Projection of whitened rows onto the complement of the free waveforms."""

    groups: tuple[tuple[np.ndarray, Complexes, Floats, Floats, Floats], ...]
    """Records, their waveforms (g, H, n, k), whitened waveforms of unit length (g, m, k),
    their length (g, k) and their Gram matrix (g, k, k)."""

    def rest(self, rows: Floats) -> Floats:
        """Rows (r, 2Hn, c), as ``real_rows`` makes them, without their projection onto the waveforms."""
        if not self.groups:
            return rows
        left = rows.copy()
        for records, _, free, _, gram in self.groups:
            left[records] -= free @ _sizes(free, gram, left[records])
        return left

    def first_sizes(self, rows: Floats, count: int) -> Floats:
        """Amplitudes of the first waveforms fitted to the rows (r, 2Hn, 1), shape (r, count)."""
        found = np.zeros((len(rows), count))
        for records, _, free, length, gram in self.groups:
            size = _sizes(free, gram, rows[records])[..., 0] / np.where(length > 0, length, np.inf)
            part = size[:, :count]
            found[records[:, None], np.arange(part.shape[1])] = part
        return found

    def rank(self) -> int:
        """Effective degrees of freedom of the free friction: the trace of its projection."""
        return round(float(self.rank_by_joint(1)[0]))

    def rank_by_joint(self, n: int) -> Floats:
        """Share of each of n joints in the effective degrees of freedom, shape (n,)."""
        found = np.zeros(n)
        for _, _, free, _, gram in self.groups:
            leverage = (free * np.linalg.solve(gram, free.swapaxes(1, 2)).swapaxes(1, 2)).sum(
                axis=(0, 2)
            )
            found += leverage.reshape(-1, n).sum(axis=0)
        return found

    def explained(self, rows: Floats, harmonics: int) -> Complexes:
        """Free friction fitted to the rows (r, 2Hn, 1), shape (r, H, n)."""
        found = np.zeros((len(rows), harmonics, rows.shape[1] // (2 * harmonics)), complex)
        for records, shapes, free, length, gram in self.groups:
            size = _sizes(free, gram, rows[records])[..., 0] / np.where(length > 0, length, np.inf)
            found[records] = np.einsum("rhnk,rk->rhn", shapes, size)
        return found


def real_rows(values: Complexes) -> Floats:
    """Complex (r, H, n, k) as real rows (r, 2Hn, k)."""
    flat = values.reshape(values.shape[0], -1, values.shape[-1])
    return np.concatenate([flat.real, flat.imag], axis=1)


def _whitened(shapes: Complexes, W: Complexes) -> tuple[Floats, Floats, Floats]:
    """Whitened waveforms of unit length, that length, and their Gram matrix."""
    free = real_rows(W @ shapes)
    length = np.linalg.norm(free, axis=1)
    free /= np.where(length > 0, length, 1.0)[:, None]
    gram = free.swapaxes(1, 2) @ free + _RIDGE * np.eye(free.shape[2])
    return free, np.asarray(length), np.asarray(gram)


def _sizes(free: Floats, gram: Floats, rows: Floats) -> Floats:
    """Least-squares amplitudes (g, k, c) of the waveforms in rows (g, m, c)."""
    return _solved(gram, free.swapaxes(1, 2) @ rows)


def _solved(gram: Floats, right: Floats) -> Floats:
    if gram.shape[1] < _MANY:
        return np.asarray(np.linalg.solve(gram, right))
    return np.asarray(
        [cho_solve(cho_factor(a, lower=True), b) for a, b in zip(gram, right, strict=True)]
    )
