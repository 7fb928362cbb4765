"""What friction is free to do around the reversals of the motors, taken out of the balance of torques.

The free shapes are columns of the Jacobian like any other; being many and of no interest, they are
projected out record by record (Golub and Pereyra, Inverse Problems 19, 2003: variable projection).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats

_RIDGE = 1e-11


@dataclass(frozen=True, eq=False)
class FreeFriction:
    """Records with about as many free shapes each: together they would be padded to the most."""

    groups: tuple[tuple[np.ndarray, Complexes], ...]
    """Indices of the records, shape (g,), and their shapes, (g, H, n, k)."""

    @classmethod
    def of(cls, shapes: Sequence[Complexes]) -> FreeFriction:
        """Group the records by how many shapes each has, (H, n, k) with a k of its own."""
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

    @property
    def shapes(self) -> int:
        """How many shapes there are; their rank may be less."""
        return sum(records.size * shapes.shape[3] for records, shapes in self.groups)

    def projection(self, W: Complexes) -> Projection:
        """Return the projection in the units of noise that W, shape (r, H, n, n), makes."""
        return Projection(
            tuple(
                (records, shapes[:, 0], *_whitened(shapes, W[records]))
                for records, shapes in self.groups
            )
        )


@dataclass(frozen=True, eq=False)
class Projection:
    """What is left of whitened rows when the free shapes have taken what they can."""

    groups: tuple[tuple[np.ndarray, Complexes, Floats, Floats, Floats], ...]
    """Records, fundamental of their shapes (g, n, k), shapes in units of noise and of unit length
    (g, m, k), that length (g, k), and the products of the shapes with each other (g, k, k)."""

    def rest(self, rows: Floats) -> Floats:
        """Rows (r, 2Hn, c), as ``real_rows`` makes them, without what the shapes explain."""
        if not self.groups:
            return rows
        left = rows.copy()
        for records, _, free, _, gram in self.groups:
            left[records] -= free @ _sizes(free, gram, left[records])
        return left

    def rank(self) -> int:
        """How many real numbers the free shapes are worth: the trace of their projection."""
        found = 0.0
        for *_, gram in self.groups:
            bare = gram - _RIDGE * np.eye(gram.shape[1])
            found += float(np.trace(np.linalg.solve(gram, bare), axis1=1, axis2=2).sum())
        return round(found)

    def fundamental(self, rows: Floats) -> Complexes | float:
        """Fundamental of the free friction that fits the rows (r, 2Hn, 1) best, shape (r, n)."""
        if not self.groups:
            return 0.0
        found = np.zeros((len(rows), self.groups[0][1].shape[1]), complex)
        for records, first, free, length, gram in self.groups:
            size = _sizes(free, gram, rows[records])[..., 0] / np.where(length > 0, length, np.inf)
            found[records] = np.einsum("rnk,rk->rn", first, size)
        return found


def real_rows(values: Complexes) -> Floats:
    """Complex (r, H, n, k) as real rows (r, 2Hn, k)."""
    flat = values.reshape(values.shape[0], -1, values.shape[-1])
    return np.concatenate([flat.real, flat.imag], axis=1)


def _whitened(shapes: Complexes, W: Complexes) -> tuple[Floats, Floats, Floats]:
    """Free shapes in units of noise and of unit length, that length, and their products."""
    free = real_rows(W @ shapes)
    length = np.linalg.norm(free, axis=1)
    free /= np.where(length > 0, length, 1.0)[:, None]
    # Neighbouring hats are nearly dependent: the ridge is where double precision ends.
    gram = free.swapaxes(1, 2) @ free + _RIDGE * np.eye(free.shape[2])
    return free, np.asarray(length), np.asarray(gram)


def _sizes(free: Floats, gram: Floats, rows: Floats) -> Floats:
    """Sizes of the shapes (g, k, c) that fit rows (g, m, c) best."""
    return np.asarray(np.linalg.solve(gram, free.swapaxes(1, 2) @ rows))
