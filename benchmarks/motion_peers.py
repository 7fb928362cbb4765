"""K, D and all inertias from two motions, compared with fits in the time domain.

Two records of 20 s at 1 kHz that begin at rest, so that the fits in the time domain know the initial
state; nothing else is known. Start values: K half, D double, inertias wrong by up to 25 %.

python -m benchmarks motion_peers [--quick]
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks.harness import NOT_INSTALLED, Cell, Table, Timing, beside, optional
from benchmarks.motion import CELL, FRICTION, Motion, given, simulate
from jointid import Inertia, MotionRecord, Study, analyse

Records = list[MotionRecord]
BAND_HZ = (2.0, 40.0)
START = given(CELL, np.inf, np.random.default_rng(8))
FRICTION_START = (0.1, 0.03, 0.002, 0.001)
GROUPS = {"K": slice(0, 2), "D": slice(2, 4), "M": slice(4, 6), "M2": slice(6, 9)}
COLUMNS = {
    "estimator": "", **{f"error of {name}, %": ".2g" for name in GROUPS},
    "studies": ".0f", "median": "ms", "× jointid": ".1f", "remark": "",
}  # fmt: skip
NOTE = (
    "Errors: the largest of all studies. The fits in the time domain know the robot's friction law, "
    "which is unknown for a real robot; they have neither a prior nor an error bar."
)


def measure(quick: bool) -> Iterator[Table]:
    """A table per motion and friction."""
    for kind in ("sweep",) if quick else ("sweep", "random"):
        for friction in ("none",) if quick else ("none", "0.05/0.01 N·m"):
            yield _case(kind, friction, quick)


def _case(kind: str, friction: str, quick: bool) -> Table:
    robot = replace(CELL, **FRICTION[friction])
    motion = Motion(kind, duration_s=6.0 if quick else 20.0, band_hz=BAND_HZ, warm_up_s=0.0)
    data = simulate([(robot, replace(motion, seed=seed)) for seed in range(1 if quick else 4)])
    found, timing = beside(_identified, _identified, data)
    rows = [_row("**jointid**", found, timing), *_in_time(data, quick, friction == "none")]
    return Table(
        "motion_peers", f"Two motions, {kind}, friction {friction}", COLUMNS, tuple(rows), (NOTE,)
    )


def _identified(records: Records) -> np.ndarray:
    fit = analyse(Study(records=records, inertia=START, inertia_std=np.inf)).fit
    assert isinstance(fit.inertia, Inertia)
    return np.concatenate([fit.K, fit.D, *_parts(fit.inertia.M, fit.inertia.M2)])


def _parts(M: np.ndarray, M2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return M, M2[[0, 1, 0], [0, 1, 1]]


def _in_time(data: list[Records], quick: bool, with_mujoco: bool) -> Iterator[dict[str, Cell]]:
    """Fits of 13 parameters: K, D, Coulomb and viscous friction, and inertias."""
    names = "grey box in time, compiled (numba)", "mujoco.sysid"
    if optional("numba") is None:
        yield from ({"estimator": f"{name}: {NOT_INSTALLED}"} for name in names)
        return
    from benchmarks import grey_box_time as in_time

    start = np.concatenate([0.5 * CELL.K, 2 * CELL.D, FRICTION_START, *_parts(START.M, START.M2)])

    def compiled(records: Records) -> np.ndarray:
        return _chosen(in_time.fit(in_time.prepare_motions(records, BAND_HZ[0]), START, start).p)

    compiled(data[0])  # numba compiles
    yield _row(names[0], *beside(compiled, _identified, data))
    if not with_mujoco:
        return
    if optional("benchmarks.mujoco_fit") is None:
        yield {"estimator": f"{names[1]}: {NOT_INSTALLED} (mujoco[sysid])"}
        return
    from benchmarks import mujoco_fit

    iterations = 1 if quick else 12

    def mujoco(records: Records) -> np.ndarray:
        prepared = in_time.prepare_motions(records, BAND_HZ[0])
        return _chosen(mujoco_fit.fit(prepared, START, start, iterations))

    remark = f"stopped after {iterations} iterations"
    yield _row(names[1], *beside(mujoco, _identified, data[:1]), remark)


def _chosen(p: np.ndarray) -> np.ndarray:
    """Without friction."""
    return np.delete(p, np.s_[4:8])


def _row(name: str, found: np.ndarray, timing: Timing, remark: str = "") -> dict[str, Cell]:
    truth = np.concatenate([CELL.K, CELL.D, *_parts(CELL.M, CELL.M2)])
    error = 100 * np.abs(found / truth - 1).max(axis=0)
    return {
        "estimator": name,
        **{f"error of {group}, %": float(error[part].max()) for group, part in GROUPS.items()},
        "studies": float(len(found)),
        "median": timing.median,
        "× jointid": timing.ratio,
        "remark": remark,
    }
