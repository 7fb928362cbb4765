"""Digest of a study: equal for equal studies only."""

import struct
from collections.abc import Iterable
from hashlib import blake2b
from weakref import WeakKeyDictionary

import numpy as np

from jointid.arrays import Floats
from jointid.files.study_keys import PARTS, robot_file
from jointid.phasors.long_records import LongRecord
from jointid.records import MotionRecord, SineRecord
from jointid.study import INERTIA_STD, Study


def study_digest(study: Study) -> str:
    """Return a key, 32 hexadecimal digits (blake2b), for caching the results of a study.

    It depends on every bit of samples, frequencies, timing, inertias with their uncertainty, nominal
    values, names, robot and date.
    """
    if study not in _digests:
        _digests[study] = _computed(study)
    return _digests[study]


_digests: WeakKeyDictionary[Study, str] = WeakKeyDictionary()
"""Digests of the studies in memory, which are immutable."""


def _computed(study: Study) -> str:
    state = blake2b(digest_size=16)
    _texts(state, (study.name, study.origin, study.description))
    inertias = [study.inertia, *study.poses.values()]
    _arrays(state, [array for inertia in inertias for array in (inertia.M, inertia.M2)])
    date = "" if study.date is None else study.date.isoformat()
    further: dict[str, object] = {
        "robot": (study.robot or date) and (study.robot, date),
        "remarks": study.remarks,
        "changes": study.changes,
        "ratio": () if study.gear_ratio is None else study.gear_ratio.tolist(),
        "deviations": (study.inertia_std, study.torque_std),
    }
    for name in PARTS:
        parts = [getattr(inertia, name) for inertia in inertias]
        further[name] = [part.tolist() for part in parts] if np.any(parts) else ()
    if (robot := study.robot_model) is not None:
        further["angles"] = [(pose, q.tolist()) for pose, q in study.pose_angles_rad.items()]
        numbers = robot.coupling, robot.rotor_inertia, *vars(robot.payload).values()
        source = robot_file(robot), robot.source[1]
        further["model"] = source, [np.asarray(values).tolist() for values in numbers]
    for name, value in further.items():  # without any, the digest is that of version 0.1
        if value and value != (INERTIA_STD, None):
            _texts(state, (name, repr(value)))
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


def _texts(state: blake2b, texts: Iterable[str]) -> None:
    for text in texts:
        data = text.encode("utf-8", "surrogatepass")
        state.update(struct.pack("<q", len(data)) + data)
    state.update(b"\xff")


def _arrays(state: blake2b, arrays: Iterable[Floats]) -> None:
    for array in arrays:
        _array(state, array)
    state.update(b"\xff")


def _array(state: blake2b, array: Floats) -> None:
    """Hash shape and values, these in Fortran order: records are stored so, and no copy is needed."""
    state.update(struct.pack(f"<{array.ndim + 1}q", array.ndim, *array.shape))
    state.update(np.ascontiguousarray(array.T).data.cast("B"))
