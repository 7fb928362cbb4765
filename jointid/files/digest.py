"""Digest of a study: equal for equal studies only."""

import struct
from collections.abc import Iterable
from hashlib import blake2b
from typing import Protocol

import numpy as np

from jointid.arrays import Floats
from jointid.phasors.long_records import LongRecord
from jointid.records import MotionRecord, SineRecord
from jointid.study import INERTIA_STD, Study


class _Hash(Protocol):
    def update(self, data: bytes | memoryview, /) -> None: ...


def study_digest(study: Study) -> str:
    """Return a key, 32 hexadecimal digits (blake2b), for caching the results of a study.

    It depends on every bit of samples, frequencies, timing, inertias with their uncertainty, nominal
    values, names, robot and date.
    """
    state = blake2b(digest_size=16)
    _texts(state, (study.name, study.origin, study.description))
    if study.robot or study.date is not None:  # without them, the digest is that of version 0.1
        _texts(state, ("robot", study.robot, "" if study.date is None else study.date.isoformat()))
    if study.remarks:
        _texts(state, ("remarks", *study.remarks))
    if study.gear_ratio is not None:
        _arrays(state, [study.gear_ratio])
    inertias = [study.inertia, *study.poses.values()]
    _arrays(state, [array for inertia in inertias for array in (inertia.M, inertia.M2)])
    if any(inertia.added.any() for inertia in inertias):
        _arrays(state, [inertia.added for inertia in inertias])
    for name in ("gravity", "shared", "shared_gravity"):
        parts = [getattr(inertia, name) for inertia in inertias]
        if any(part.any() for part in parts):
            _arrays(state, parts)
    if study.robot_model is not None:
        robot, angles = study.robot_model, study.pose_angles_rad
        state.update(robot.source[1])
        _texts(state, ("model", robot.source[0], *angles))
        _arrays(state, [*angles.values(), robot.coupling, robot.rotor_inertia, robot.payload.parameters])
    if (study.inertia_std, study.torque_std) != (INERTIA_STD, None):
        _texts(state, ("deviations", repr(study.inertia_std), repr(study.torque_std)))
    if study.changes:
        _texts(state, ("changes", *study.changes))
    _texts(state, study.poses)
    _arrays(state, [] if study.nominal is None else [study.nominal.K, study.nominal.D])
    for record in study.records:
        _texts(state, (record.label, "pose " + record.pose if record.pose is not None else ""))
        begins = float("nan") if record.start_s is None else record.start_s
        frequency = record.frequency_hz if isinstance(record, SineRecord) else float("nan")
        timing = (frequency, float(record.torque_hold), record.torque_delay_s, begins)
        state.update(struct.pack("<4d", *timing))
        if isinstance(record, LongRecord):
            _texts(state, ("long", record.fingerprint()))
            continue
        for array in (record.time_s, record.theta_rad, record.tau_Nm):
            _array(state, array)
        if isinstance(record, MotionRecord):
            _texts(state, ("motion", repr(record.band_hz)))
            _arrays(state, [] if record.arm_rad is None else [record.arm_rad])
    return state.hexdigest()


def _texts(state: _Hash, texts: Iterable[str]) -> None:
    for text in texts:
        data = text.encode("utf-8", "surrogatepass")
        state.update(struct.pack("<q", len(data)) + data)
    state.update(b"\xff")


def _arrays(state: _Hash, arrays: Iterable[Floats]) -> None:
    for array in arrays:
        _array(state, array)
    state.update(b"\xff")


def _array(state: _Hash, array: Floats) -> None:
    """Hash shape and values, these in Fortran order: records are stored so, and no copy is needed."""
    state.update(struct.pack(f"<{array.ndim + 1}q", array.ndim, *array.shape))
    state.update(np.ascontiguousarray(array.T).data.cast("B"))
