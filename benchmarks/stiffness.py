"""K and D from records, compared with the software that a user would choose instead.

The campaign: 18 frequencies × 2 records, 12.5 periods each at 4 kHz, 16-bit encoder, noise on the logged
torque; without friction, with mild and with heavy Coulomb friction. Every time starts at the records.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks import grey_box_frequency as frequency
from benchmarks.campaign import (
    ANSWER,
    COUNT_RAD,
    FREQUENCIES_HZ,
    FRICTION,
    INERTIA,
    TORQUE_NOISE_NM,
    simulated,
)
from benchmarks.harness import NOT_INSTALLED, Cell, Table, Timing, beside, interleaved, optional
from jointid import SineRecord, extract_phasors, identify_elasticity
from jointid.estimation.estimators.maximum_likelihood import maximum_likelihood

Records = tuple[SineRecord, ...]
Estimator = Callable[[Records], np.ndarray]

START = ANSWER * np.array([0.5, 0.5, 2.0, 2.0])
"""Start values of the grey-box fits, as from a data sheet."""
FRICTION_START = np.array([0.1, 0.03, 0.002, 0.001])
COLUMNS = {
    "estimator": "",
    "K1": "",
    "K2": "",
    "D1": "",
    "D2": "",
    "campaigns": ".0f",
    "median": "ms",
    "spread": "",
    "× jointid": ".2f",
    "remark": "",
}
JOINTID = "**jointid**, auto"


@dataclass(frozen=True)
class Effort:
    """Amount of work, which the quick run reduces."""

    seeds: int
    expensive_seeds: int
    time_starts: int
    starts: int
    rounds: int
    frequencies_hz: tuple[float, ...]
    periods: float
    mujoco_iterations: int


FULL = Effort(20, 2, 4, 50, 9, tuple(FREQUENCIES_HZ), 12.5, 4)
QUICK = Effort(2, 1, 1, 2, 1, (12.0, 18.0, 27.0), 4.0, 1)


def measure(quick: bool) -> Iterator[Table]:
    """A table per case of friction, and one of starts; minutes pass between them."""
    effort = QUICK if quick else FULL
    for friction in ["mild"] if quick else FRICTION:
        yield _case(friction, effort)
    yield _convergence(effort)


def campaigns(friction: str, effort: Effort) -> list[Records]:
    return [_campaign(friction, seed, effort) for seed in range(effort.seeds)]


def _campaign(friction: str, seed: int, effort: Effort) -> Records:
    chosen = np.array(effort.frequencies_hz)
    return simulated(friction, seed, frequencies_hz=chosen, periods=effort.periods)


def _case(friction: str, effort: Effort) -> Table:
    data = campaigns(friction, effort)
    estimators: dict[str, Estimator] = {
        JOINTID: _auto,
        "jointid, weighted": lambda r: _identified(r, "weighted"),
        "the paper's least squares (jointid)": lambda r: _identified(r, "least-squares"),
        "grey box in frequency (scipy), bounded": lambda r: _grey(r, "plain"),
        "the same, relative to the size of H": lambda r: _grey(r, "size"),
        "the same, weighted by jointid's noise of H": lambda r: _grey(r, "noise"),
    }
    timings = interleaved(
        {name: lambda f=f: f(data[0]) for name, f in estimators.items()},
        against=JOINTID,
        rounds=effort.rounds,
    )
    rows = []
    for name, estimator in estimators.items():
        found = np.array([estimator(records) for records in data])
        rows.append(_row(name, found, timings[name]))
    if friction == "none":
        rows.append(_bound(data[0]))
    # MuJoCo takes minutes for each campaign: only where friction must be separated from damping.
    rows += _expensive(data, effort, with_mujoco=effort is QUICK or friction == "heavy")
    size = sum(record.time_s.size for record in data[0])
    coulomb = " and ".join(f"{c:g}" for c in FRICTION[friction])
    what = "no friction" if friction == "none" else f"{friction} friction, {coulomb} N·m"
    title = f"K and D from {len(data[0])} records of {size:,} samples together, {what}"
    return Table(f"stiffness, {friction}", title, COLUMNS, tuple(rows), (NOTE,))


NOTE = (
    "Errors: root mean square over the campaigns, and their standard deviation σ, in % of the truth. "
    "Times begin at the records; the grey boxes in frequency get the phasors of the fundamental only, "
    "which is all they use. The grey box in time knows the robot's friction law, which is "
    "unknown for a real robot, and integrates it as the simulator does."
)


def _row(name: str, found: np.ndarray, timing: Timing, remark: str = "") -> dict[str, Cell]:
    error = 100 * (found / ANSWER - 1)
    off, scatter = np.sqrt((error**2).mean(axis=0)), error.std(axis=0, ddof=1 if len(error) > 1 else 0)
    cells = [
        f"{a:.2g}" if len(error) < 10 else f"{a:.2g} (σ {s:.2g})"
        for a, s in zip(off, scatter, strict=True)
    ]
    return {
        "estimator": name,
        **dict(zip(("K1", "K2", "D1", "D2"), cells, strict=True)),
        "campaigns": float(len(error)),
        "median": timing.median,
        "spread": timing.spread,
        "× jointid": timing.ratio,
        "remark": remark,
    }


def _bound(records: Records) -> dict[str, Cell]:
    """Smallest standard deviation that an unbiased estimator can have, of the noise as it was simulated.

    The encoder's rounding is white where the motor passes many counts in a period, as it does here.
    """
    variance = np.array([COUNT_RAD**2 / 12] * 2 + [noise**2 for noise in TORQUE_NOISE_NM])
    phasors = extract_phasors(records, harmonics=1)
    covariance = np.array([np.diag(4 * variance / r.samples).astype(complex) for r in records])
    exact = replace(
        phasors,
        covariance=covariance,
        harmonic_covariance=covariance[:, None],
        degrees_of_freedom=np.full(len(records), 1e9),
    )
    least = np.sqrt(np.diag(maximum_likelihood(exact, INERTIA, ANSWER).covariance))
    cells = [f"σ {100 * value:.2g}" for value in least / ANSWER]
    return {
        "estimator": "Cramér–Rao bound",
        **dict(zip(("K1", "K2", "D1", "D2"), cells, strict=True)),
        "remark": "no unbiased estimator scatters less",
    }


def _identified(records: Records, method: str) -> np.ndarray:
    fit = identify_elasticity(extract_phasors(records), INERTIA, method=method)
    return np.concatenate([fit.K, fit.D])


def _auto(records: Records) -> np.ndarray:
    return _identified(records, "auto")


def _grey(records: Records, weight: frequency.Weight) -> np.ndarray:
    return frequency.fit(frequency.measured(records), INERTIA, START, weight).p


def _expensive(data: list[Records], effort: Effort, *, with_mujoco: bool) -> list[dict[str, Cell]]:
    """Fits in the time domain: seconds to minutes, so few campaigns, each timed once beside jointid."""
    rows: list[dict[str, Cell]] = []
    few = data[: effort.expensive_seeds]
    name = "grey box in time, 8 parameters, compiled (numba)"
    if optional("numba") is None:
        return [{"estimator": f"{n}: {NOT_INSTALLED}"} for n in (name, "mujoco.sysid, 8 parameters")]
    from benchmarks import grey_box_time as in_time

    _grey_in_time(few[0], START)  # compiles
    found, timing = beside(lambda r: _grey_in_time(r, START)[:4], _auto, few)
    rows.append(_row(name, found, timing, _share_of_starts(few[0], effort)))
    if not with_mujoco:
        return rows
    name = "mujoco.sysid, 8 parameters"
    if optional("benchmarks.mujoco_fit") is None:
        return [*rows, {"estimator": f"{name}: {NOT_INSTALLED} (mujoco[sysid])"}]
    from benchmarks import mujoco_fit

    def mujoco(records: Records) -> np.ndarray:
        # From the answer of the frequency domain: far starts make its integrator unstable.
        start = np.concatenate([_grey(records, "size"), FRICTION_START])
        prepared = in_time.prepare(records, INERTIA)
        return mujoco_fit.fit(prepared, INERTIA, start, effort.mujoco_iterations)[:4]

    try:
        found, timing = beside(mujoco, _auto, few[:1])
    except Exception as error:  # an alternative that fails is a row that says so
        reason = f"failed: {type(error).__name__}: {error}"
        return [*rows, {"estimator": name, "remark": reason[:120]}]
    remark = f"stopped after {effort.mujoco_iterations} iterations from the grey box in frequency"
    return [*rows, _row(name, found, timing, remark)]


def _grey_in_time(records: Records, start: np.ndarray) -> np.ndarray:
    from benchmarks import grey_box_time as in_time

    whole = np.concatenate([start, FRICTION_START])
    return in_time.fit(in_time.prepare(records, INERTIA), INERTIA, whole).p


def _share_of_starts(records: Records, effort: Effort) -> str:
    """Share of starts within half a decade from which the time-domain fit reaches the best cost."""
    from benchmarks import grey_box_time as in_time

    rng = np.random.default_rng(8)
    data = in_time.prepare(records, INERTIA)
    base = np.concatenate([ANSWER, FRICTION_START])
    spread = 10 ** rng.uniform(-0.5, 0.5, (effort.time_starts, 8))
    answers = [in_time.fit(data, INERTIA, base * factor) for factor in spread]
    # The last weights, and with them the cost, are each fit's own: so the parameters are compared.
    p = np.array([a.p[:4] for a in answers])
    middle = p[np.argmin(np.abs(np.log(p / ANSWER)).sum(axis=1))]
    reached = (np.abs(p / middle - 1) < 0.01).all(axis=1).sum()
    return f"{reached} of {len(p)} starts within half a decade reach the same"


def _convergence(effort: Effort) -> Table:
    """How often the frequency-domain fit ends within 1 % of the true values, from random starts."""
    rng = np.random.default_rng(50)
    H = frequency.measured(_campaign("none", 0, effort))
    rows: list[dict[str, Cell]] = []
    for decades in (1.0, 2.0):
        starts = ANSWER * 10 ** rng.uniform(-decades, decades, (effort.starts, 4))
        for name, fit in [
            ("default settings", frequency.fit_by_default),
            ("bounded, logarithmic, scaled", lambda *a: frequency.fit(*a, "plain")),
            ("the same, relative to the size of H", lambda *a: frequency.fit(*a, "size")),
        ]:
            begin = time.perf_counter()
            found = np.array([fit(H, INERTIA, start).p for start in starts])
            seconds = (time.perf_counter() - begin) / len(starts)
            good = (np.abs(found / ANSWER - 1) < 0.01).all(axis=1).sum()
            rows.append(
                {
                    "scipy.optimize.least_squares on H": name,
                    "starts": f"± {decades:g} decade{'s' if decades > 1 else ''}",
                    "converge": f"{good} of {len(starts)}",
                    "per fit": seconds,
                }
            )
    rows.append({"scipy.optimize.least_squares on H": "jointid: needs no start"})
    form = {"scipy.optimize.least_squares on H": "", "starts": "", "converge": "", "per fit": "ms"}
    title = "Starts from which the grey box in frequency converges, no friction"
    return Table("stiffness, starts", title, form, tuple(rows))
