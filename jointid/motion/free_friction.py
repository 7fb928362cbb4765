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
from jointid.motion.complement import DEPENDENT, Basis, Complement, Waveforms
from jointid.small_matrices import inverse

_MANY = 48
"""Number of waveforms from which Cholesky's method is faster despite a call per record."""
_RIDGE = DEPENDENT
"""Added to the Gram matrix of unit columns: neighbouring hat functions are nearly dependent."""


@dataclass(frozen=True, eq=False)
class FreeFriction:
    """Waveforms of all records, in groups of records with similarly many, to limit the padding."""

    groups: tuple[tuple[np.ndarray, Complexes], ...] = ()
    """Indices of the records, shape (g,), and their waveforms, (g, H, n, k), padded with zeros."""
    sized: int = 0
    """Number of last waveforms of every group with standard deviation 1, motor by motor."""
    ends: tuple[np.ndarray, Complexes] | None = None
    """Indices of some records, shape (m,), and further columns, (m, H, n, k)."""
    bases: tuple[Basis, ...] = ()
    """In place of the groups, for motions: the basis of each record, with bounded friction."""
    shapes: int = 0
    """Number of waveforms; their rank may be smaller."""

    @property
    def has_known_sizes(self) -> bool:
        """Whether the standard deviations of some waveforms are known."""
        return bool(self.sized or self.bases)

    @classmethod
    def of(cls, records: Sequence[Waveforms], sizes: Floats, levels: Complexes) -> FreeFriction:
        """Collect the waveforms of the records, each at its own first bins of H.

        ``sizes``, shape (r, n), are the standard deviations of the bounded ones, and ``levels``, (r, H,
        n, c), others of standard deviation 1. Only the complement, which takes both as noise, knows
        that the friction of a reversal is one torque in all bins.
        """
        counts = np.array([own.count for own in records], dtype=int)
        _, H, n, differing = levels.shape
        if any(each.shape[1] for own in records for each in own.bounded):
            bases = tuple(own.basis.sized(size) for own, size in zip(records, sizes, strict=True))
            if differing:
                bases = tuple(map(Basis.with_levels, bases, levels))
            return cls(bases=bases, shapes=int(sum(basis.freed.sum() for basis in bases)))
        doublings = np.ceil(np.log2(np.maximum(counts, 1))).astype(int)
        groups = []
        used = (counts > 0) | (differing > 0)
        for doubling in np.unique(doublings[used]).tolist():
            members = np.flatnonzero((doublings == doubling) & used)
            padded = np.zeros((members.size, H, n, counts[members].max() + n * differing), complex)
            of_motors = np.sqrt(2) * levels[members][:, :, :, None] * np.eye(n)[..., None]
            padded[..., counts[members].max() :] = of_motors.reshape(members.size, H, n, -1)
            for place, member in zip(padded, members.tolist(), strict=True):
                first = 0
                for j, own in enumerate(records[member].free):
                    place[: len(own), j, first : first + own.shape[1]] = own
                    first += own.shape[1]
            groups.append((members, padded))
        return cls(tuple(groups), n * differing, shapes=int(counts.sum()))

    def with_columns(self, records: np.ndarray, columns: Complexes) -> FreeFriction:
        """Project columns (m, H, n, k) of some records (m,) out as well."""
        return replace(self, ends=(records, columns))

    def scaled(self, scale: Floats) -> FreeFriction:
        """With other standard deviations, by factors (n,), where they are known."""
        sizes = np.repeat(scale, self.sized // scale.size)

        def by(each: Complexes) -> Complexes:
            return each * np.pad(sizes, (each.shape[3] - self.sized, 0), constant_values=1.0)

        groups = tuple((k, by(each)) for k, each in self.groups)
        return replace(self, groups=groups, bases=tuple(basis.sized(scale) for basis in self.bases))

    def moved(self, factor: Complexes) -> FreeFriction:
        """The waveforms of the records times phase factors (r, H, n): at other times."""
        groups = tuple((k, each * factor[k][..., None]) for k, each in self.groups)
        return replace(self, groups=groups, bases=tuple(map(Basis.moved, self.bases, factor)))

    def of_known_size(self, rows: Floats) -> Complexes:
        """Torque (r, H, n) by waveforms of standard deviation 1, for the rows that are left, (r, m)."""
        found = np.zeros((len(rows), *self.groups[0][1].shape[1:3]), complex)
        for k, each in self.groups:
            amplitudes = -rows[k, rows.shape[1] - self.sized :]
            found[k] = np.einsum("ghnk,gk->ghn", each[..., each.shape[3] - self.sized :], amplitudes)
        return found

    def projection(self, W: Complexes, V: Complexes) -> Projection:
        """Return the projection for the whitening matrices W of the covariances V, (r, H, n, n)."""
        complement = Complement.of(self.bases, V) if self.bases else None
        if complement:
            columns = [Columns.of(np.array([k]), each[None]) for k, each in complement.columns()]
        else:
            columns = [Columns.of(k, self._real_rows(W[k] @ each)) for k, each in self.groups]
        free = Projection(W, tuple(columns), complement, self.sized)
        if self.ends is None:
            return free
        records, shapes = self.ends
        whole = np.zeros((*W.shape[:3], shapes.shape[3]), complex)
        whole[records] = shapes
        left, size = free.rows(whole)[records], np.linalg.norm(W[records] @ shapes, axis=(1, 2))
        left *= np.linalg.norm(left, axis=1, keepdims=True) > np.sqrt(DEPENDENT) * size[:, None]
        return replace(free, ends=Columns.of(records, left))

    def _real_rows(self, waveforms: Complexes) -> Floats:
        """Real rows of whitened waveforms; an amplitude of known size is a measurement of zero."""
        rows, k = real_rows(waveforms), waveforms.shape[3]
        if not self.sized:
            return rows
        measured = np.broadcast_to(np.eye(k)[k - self.sized :], (len(rows), self.sized, k))
        return np.concatenate([rows, measured], axis=1)


@dataclass(frozen=True, eq=False)
class Columns:
    """Whitened columns of unit length, projected out of the rows of some records."""

    records: np.ndarray
    free: Floats
    """Shape (g, m, k)."""
    length: Floats
    """Original length of each column, shape (g, k)."""
    gram: Floats
    """Shape (g, k, k)."""

    @classmethod
    def of(cls, records: np.ndarray, free: Floats) -> Columns:
        """Scale columns (g, m, k) to unit length, in place."""
        length = np.sqrt(np.einsum("gmk,gmk->gk", free, free))
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

    def leverage(self, data: int | None = None) -> Floats:
        """Share of every row that is free, shape (g, m).

        Rows from ``data`` on are no data, but known amplitudes: the others then keep some of the noise.
        """
        shares = self.free @ np.linalg.inv(self.gram)
        known = self.free[:, len(self.free[0]) if data is None else data :]
        by_known = ((shares @ known.swapaxes(1, 2)) ** 2).sum(axis=2)
        return np.asarray(np.einsum("gmk,gmk->gm", self.free, shares) + by_known)[:, :data]


@dataclass(frozen=True, eq=False)
class Projection:
    """Projection of whitened rows onto the complement of the free waveforms."""

    W: Complexes
    """Whitening matrices, shape (r, H, n, n)."""
    columns: tuple[Columns, ...]
    """Columns of disjoint groups of records."""
    complement: Complement | None
    """Coordinates of the rows; bins by default."""
    sized: int = 0
    """Number of further rows: amplitudes with a standard deviation, beside the bins."""
    ends: Columns | None = None
    """Further columns, orthogonal to the others."""

    def _coordinates(self, values: Complexes) -> Floats:
        if self.complement:
            return self.complement.rows(values)
        rows = real_rows(self.W @ values)
        return np.pad(rows, ((0, 0), (0, self.sized), (0, 0))) if self.sized else rows

    def rows(self, values: Complexes) -> Floats:
        """Whitened rows (r, m, c) of values (r, H, n, c) without their part in the waveforms.

        They are real and imaginary parts of all bins and joints, or coordinates of the complement.
        """
        left = self._coordinates(values)
        for each in (*self.columns, *([self.ends] if self.ends else [])):
            left[each.records] = each.rest(left[each.records])
        return left

    def whitened(self, rows: Floats) -> Complexes:
        """Rows (r, m, c) of the complement as complex values of all bins, shape (r, H, n, c)."""
        if self.complement:
            return np.asarray(self.W @ (self.complement.V @ self.complement.weighted(rows)))
        real, imaginary = np.split(rows[:, : rows.shape[1] - self.sized], 2, axis=1)
        return np.asarray((real + 1j * imaginary).reshape(*self.W.shape[:3], -1))

    def first_sizes(self, values: Complexes, count: int) -> Floats:
        """Amplitudes (r, count) of the first of the further columns in values (r, H, n, 1)."""
        found = np.zeros((len(values), count))
        if self.ends:
            length = np.where(self.ends.length > 0, self.ends.length, np.inf)
            rows = self._coordinates(values)[self.ends.records]
            found[self.ends.records] = (self.ends.sizes(rows)[..., 0] / length)[:, :count]
        return found

    def rank(self) -> int:
        """Effective degrees of freedom of the free friction: the trace of its projection."""
        found = self.ends.rank() if self.ends else 0.0
        if self.complement:  # its columns may have a known size
            return round(found + float(sum(basis.freed.sum() for basis in self.complement.bases)))
        return round(found + sum(each.rank() - each.records.size * self.sized for each in self.columns))

    def noise_left(self, known: Floats) -> Floats:
        """Degrees of freedom (r, n) of the noise that the projection leaves, of those known, (r, 1)."""
        n = self.W.shape[2]
        if self.complement:
            found, bases = self.complement.noise_left(), self.complement.bases
            for each in self.columns:
                record = int(each.records[0])
                taken, of_row = each.leverage(self.complement.coordinates)[0], bases[record].of_row
                found[record] -= np.bincount(of_row, taken[: of_row.size], n)
            if self.ends:  # they take from all joints alike
                found[self.ends.records] -= self.ends.leverage().sum(axis=1, keepdims=True) / n
            return found
        taken = np.zeros((len(self.W), 2 * self.W.shape[1] * n))
        for each in (*self.columns, *([self.ends] if self.ends else [])):
            taken[each.records] += each.leverage(taken.shape[1])
        return np.asarray(known - taken.reshape(len(taken), -1, n).sum(axis=1))

    def explained(self, values: Complexes) -> Complexes:
        """Free friction in the values (r, H, n, 1) in use, shape (r, H, n)."""
        free = self.W @ values - self.whitened(self.rows(values))
        used = np.diagonal(self.W, axis1=2, axis2=3) != 0
        back = inverse(self.W + np.eye(self.W.shape[-1]) * ~used[..., None])
        return np.asarray(np.where(used, (back @ free)[..., 0], 0))


def real_rows(values: Complexes) -> Floats:
    """Complex (r, H, n, k) as real rows (r, 2Hn, k)."""
    r, H, n, k = values.shape
    flat = values.reshape(r, H * n, k)
    return np.concatenate([flat.real, flat.imag], axis=1)
