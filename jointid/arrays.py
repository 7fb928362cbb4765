"""Checked, read-only arrays for the dataclasses of this package."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointid.errors import JointIdError

_LARGEST = 1e100
"""Largest accepted magnitude: its square is finite, and no physical quantity is near."""

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


def per_joint(name: str, value: ArrayLike, n: int) -> Floats:
    """Return a setting of n joints as (n,); a single number applies to all joints.

    Raises JointIdError when the value has neither one element nor n.
    """
    array = finite_array(name, np.atleast_1d(np.asarray(value)), ndim=1)
    if array.size not in (1, n):
        raise JointIdError(f"{name} has {array.size} values: give one, or one per joint ({n}).")
    return np.array(np.broadcast_to(array, (n,)))


def finite_array(name: str, value: ArrayLike, *, ndim: int, order: Any = None) -> Floats:
    """Return ``value`` as a read-only float64 copy with ``ndim`` dimensions, in memory order "C" or "F".

    ``name`` is that of the value with its unit, for the error message. Raises JointIdError when the
    value is not numeric, has another number of dimensions or is not finite.
    """
    try:
        if np.asarray(value).dtype.kind not in "iufO":  # text, dates, truth values, complex numbers
            raise TypeError
        array = np.array(value, dtype=np.float64, order=order)
    except (TypeError, ValueError, OverflowError) as error:
        raise JointIdError(f"{name}: expected real numbers, got {value!r:.80}.") from error
    if array.ndim == 0:
        array = array.reshape((1,) * ndim)  # a single joint may give a plain number
    if array.ndim != ndim:
        expected = {0: "a number", 1: "a list of numbers", 2: "a table of numbers"}[ndim]
        raise JointIdError(f"{name}: expected {expected}, got an array of shape {array.shape}.")
    usable = np.abs(array) < _LARGEST  # false for NaN as well
    if not usable.all():
        where = tuple(int(i) for i in np.argwhere(~usable)[0])
        place = f" at index {where if ndim > 1 else where[0]}" if where else ""
        raise JointIdError(
            f"{name}: the value{place} is {array[where]:g}; every value must be finite. "
            "Remove or repair it."
        )
    array.setflags(write=False)
    return array


def vectors(name: str, value: ArrayLike, n: int) -> Floats:
    """Return values of shape (..., n) as float64.

    Raises JointIdError when they are not numeric, not finite or of another shape.
    """
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise JointIdError(f"{name}: expected numbers, got {value!r:.80}.") from error
    if array.ndim == 0 or array.shape[-1] != n:
        raise JointIdError(f"{name} has shape {array.shape}: expected (..., {n}), {n} finite values.")
    if not np.isfinite(array).all():
        j = int(np.argwhere(~np.isfinite(array))[0][-1])
        raise JointIdError(f"{name}: component {j + 1} is not finite: remove or repair it.")
    return array


def bounded_number(name: str, unit: str, value: ArrayLike, *, zero: bool = False) -> float:
    """Return a setting that must be positive, or not negative if ``zero`` is allowed.

    Raises JointIdError when the value is not a finite number or out of range.
    """
    number = float(finite_array(f"{name} ({unit})" if unit else name, value, ndim=0))
    if number < 0 or (number == 0 and not zero):
        rule = "not be negative" if zero else "be positive"
        raise JointIdError(f"{f'{name} = {number:g} {unit}'.rstrip()}: it must {rule}.")
    return number


def whole_number(name: str, value: object, least: int, most: float = np.inf) -> int:
    """Return a setting that counts something.

    Raises JointIdError when the value is not a whole number from ``least`` to ``most``.
    """
    if isinstance(value, int | np.integer) and not isinstance(value, bool) and least <= value <= most:
        return int(value)
    allowed = f"from {least} to {most}" if np.isfinite(most) else f"of at least {least}"
    raise JointIdError(f"{name} = {value!r}: expected a whole number {allowed}.")


def set_fields(instance: object, **values: object) -> None:
    """Set fields of a frozen dataclass, in its constructor."""
    for name, value in values.items():
        object.__setattr__(instance, name, value)


def frozen(array: Floats) -> Floats:
    """Return a read-only copy."""
    copy = array.copy()
    copy.setflags(write=False)
    return copy


def true_runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the runs of True in a mask, shape (N,), each as its first index and one past its last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    return [(int(first), int(last)) for first, last in edges.reshape(-1, 2)]
