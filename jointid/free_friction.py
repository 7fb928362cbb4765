"""What friction is free to do around the reversals of the motors, taken out of the balance of torques.

The free shapes are columns of the Jacobian like any other; being many and of no interest, they are
projected out record by record (Golub and Pereyra, Inverse Problems 19, 2003: variable projection).
"""

from __future__ import annotations

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
    def of(cls, shapes: Complexes) -> FreeFriction:
        """Group the records by their shapes, (r, H, n, k), zero where a record has fewer."""
        counts = np.any(shapes != 0, axis=(1, 2)).sum(axis=1)
        first = np.argsort(~np.any(shapes != 0, axis=(1, 2)), axis=1, kind="stable")
        ordered = np.take_along_axis(shapes, first[:, None, None], axis=3)
        sizes = np.ceil(np.log2(np.maximum(counts, 1))).astype(int) * (counts > 0)
        groups = []
        for size in np.unique(sizes[counts > 0]).tolist():
            records = np.flatnonzero((sizes == size) & (counts > 0))
            groups.append((records, ordered[records][..., : counts[records].max()]))
        return cls(tuple(groups))

    @property
    def shapes(self) -> int:
        """How many shapes there are; their rank may be less."""
        return sum(records.size * shapes.shape[3] for records, shapes in self.groups)

    def take_out(self, rows: Floats, W: Complexes) -> None:
        """Project the free shapes out of whitened rows (r, 2Hn, c), in place.

        Parameters
        ----------
        rows : ndarray
            As ``real_rows`` makes them of (r, H, n, c).
        W : ndarray, shape (r, H, n, n)
            What has whitened the rows.
        """
        for records, shapes in self.groups:
            free, gram = _whitened(shapes, W[records])
            part = rows[records]
            rows[records] = part - free @ np.linalg.solve(gram, free.swapaxes(1, 2) @ part)

    def rank(self, W: Complexes) -> int:
        """How many real numbers the free shapes are worth: the trace of their projection."""
        trace = 0.0
        for records, shapes in self.groups:
            free, gram = _whitened(shapes, W[records])
            outer = free.swapaxes(1, 2) @ free
            trace += float(np.einsum("rkk->", np.linalg.solve(gram, outer)))
        return round(trace)

    def fundamental(self, r: Complexes, W: Complexes) -> Complexes:
        """Fundamental of the free friction that fits the balances r (r, H, n) best, shape (r, n)."""
        found = np.zeros_like(r[:, 0])
        for records, shapes in self.groups:
            free, gram = _whitened(shapes, W[records])
            length = np.linalg.norm(real_rows(W[records] @ shapes), axis=1)
            rows = real_rows(W[records] @ r[records][..., None])
            size = np.linalg.solve(gram, free.swapaxes(1, 2) @ rows)[..., 0]
            size = size / np.where(length > 0, length, np.inf)
            found[records] = np.einsum("rnk,rk->rn", shapes[:, 0], size)
        return found


def real_rows(values: Complexes) -> Floats:
    """Complex (r, H, n, k) as real rows (r, 2Hn, k)."""
    flat = values.reshape(values.shape[0], -1, values.shape[-1])
    return np.concatenate([flat.real, flat.imag], axis=1)


def _whitened(shapes: Complexes, W: Complexes) -> tuple[Floats, Floats]:
    """Free shapes in units of noise, of unit length (g, m, k), and their Gram matrices."""
    free = real_rows(W @ shapes)
    length = np.linalg.norm(free, axis=1, keepdims=True)
    free /= np.where(length > 0, length, 1.0)
    # Neighbouring hats are nearly dependent: the ridge is where double precision ends.
    gram = free.swapaxes(1, 2) @ free + _RIDGE * np.eye(free.shape[2])
    return free, gram
