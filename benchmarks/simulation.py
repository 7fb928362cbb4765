"""The simulated robot compared with solve_ivp, the cut with real time, the map with single cuts.

Both simulators get the same robot, controller, initial state and samples; a tight solve_ivp run is the
reference of both. Without friction that is a linear system, so all records advance in one call; with
Coulomb friction every record slides, sticks and turns round at its own times, so each runs by itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from benchmarks.campaign import INERTIA, TRUTH
from benchmarks.harness import Cell, Table, interleaved
from jointid import (
    Controller,
    Excitation,
    MotorFriction,
    PlanarArm,
    rectangle,
    simulate_records,
    track,
)
from jointid.cut.path_errors import errors_of_mismatch

COULOMB = np.array([0.4, 0.08])
VISCOUS = np.array([0.002, 0.0005])
ROBOT_COLUMNS = {
    "simulator": "",
    "friction": "",
    "median": "ms",
    "spread": "",
    "× jointid": ".1f",
    "largest error of an angle": ".1e",
}
CUT_COLUMNS = {"what": "", "median": "ms", "spread": "", "remark": ""}


def measure(quick: bool) -> list[Table]:
    return [_robot(quick), _cut(quick)]


@dataclass(frozen=True)
class Experiment:
    """Sine experiments under sampled control, as both simulators understand them."""

    frequencies_hz: np.ndarray
    duration_s: float
    friction: bool
    rate_hz: float = 1000.0

    @property
    def excitation(self) -> Excitation:
        return Excitation(duration_s=self.duration_s, velocity_rad_s=8.0, settle_s=0.0)

    @property
    def viscous(self) -> np.ndarray:
        return VISCOUS if self.friction else np.zeros(2)

    def by_jointid(self) -> np.ndarray:
        """Motor angles, (N, 2, R)."""
        friction = MotorFriction(COULOMB, VISCOUS) if self.friction else None
        records = simulate_records(
            INERTIA,
            TRUTH,
            self.frequencies_hz,
            excitation=self.excitation,
            controller=Controller(sample_rate_hz=self.rate_hz),
            friction=friction,
        )
        return np.stack([record.theta_rad for record in records], axis=2)

    def by_solve_ivp(self, method: str, rtol: float) -> np.ndarray:
        """The same by scipy: one call per control sample, because the held torque jumps there."""
        loop = _Loop(self)
        columns = self.frequencies_hz.size * 2
        if not self.friction:
            return loop.run(
                np.arange(columns), lambda x, tau: _smooth(loop.A, x, tau, loop, method, rtol)
            )
        runs = [
            loop.run(np.array([r]), lambda x, tau: _rubbing(x, tau, loop, method, rtol))
            for r in range(columns)
        ]
        return np.concatenate(runs, axis=2)


class _Loop:
    """Plant, controller and their exact steady state without Coulomb friction, written independently."""

    def __init__(self, experiment: Experiment) -> None:
        self.experiment, self.T = experiment, 1 / experiment.rate_hz
        K, D = np.diag(TRUTH.K), np.diag(TRUTH.D)
        mass = np.zeros((4, 4))
        mass[:2, :2], mass[2:, 2:] = np.diag(INERTIA.M), INERTIA.M2
        forces = np.block([[-K, K, -D - np.diag(experiment.viscous), D], [K, -K, D, -D]])
        self.A = np.zeros((8, 8))
        self.A[:4, 4:] = np.eye(4)
        self.A[4:] = np.linalg.solve(mass, forces)
        self.B = np.zeros((8, 2))
        self.B[4:6] = np.diag(1 / INERTIA.M)
        J = INERTIA.M + np.diag(INERTIA.M2)
        self.kp, self.kv = J * (20 * np.pi) ** 2, J * 20 * np.pi  # 10 Hz, damping ratio 0.5
        self.feedforward = np.diag(INERTIA.M) + INERTIA.M2
        omega = 2 * np.pi * experiment.frequencies_hz
        excitation = experiment.excitation
        A = excitation.amplitudes(omega, 2)[:, None, :] * excitation.weights(2)
        self.omega, self.amplitude = np.repeat(omega, 2), A.reshape(-1, 2)

    def run(
        self, columns: np.ndarray, advance: Callable[[np.ndarray, np.ndarray], np.ndarray]
    ) -> np.ndarray:
        omega, A = self.omega[columns], self.amplitude[columns].T
        x, y_before = self._steady(omega, A)
        samples = int(np.ceil(self.experiment.duration_s / self.T - 1e-6))
        log = np.empty((samples, 2, columns.size))
        for k in range(samples):
            now, past = (np.imag(A * np.exp(1j * omega * i * self.T)) for i in (k, k - 1))
            y = x[:2]
            torque = self.kp[:, None] * (now - y) - self.feedforward @ (omega**2 * now)
            torque += self.kv[:, None] * (now - past - y + y_before) / self.T
            log[k], y_before = y, y.copy()
            x = advance(x, torque)
        return log

    def _steady(self, omega: np.ndarray, A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Steady state at sample 0, and motor angles at sample −1."""
        whole = np.zeros((10, 10))
        whole[:8, :8], whole[:8, 8:] = self.A, self.B
        step = expm(whole * self.T)
        E, G = step[:8, :8], step[:8, 8:]
        C = np.eye(2, 8)
        x, before = [], []
        for w, a in zip(omega, A.T, strict=True):
            z = np.exp(1j * w * self.T)
            control = np.diag(self.kp + self.kv / self.T * (1 - 1 / z))
            state = np.linalg.solve(
                z * np.eye(8) - E + G @ control @ C, G @ (control - w**2 * self.feedforward) @ a
            )
            x.append(state.imag)
            before.append((state[:2] / z).imag)
        return np.array(x).T, np.array(before).T


def _smooth(
    A: np.ndarray, x: np.ndarray, tau: np.ndarray, loop: _Loop, method: str, rtol: float
) -> np.ndarray:
    shape, drive = x.shape, loop.B @ tau

    def slope(_t: float, state: np.ndarray) -> np.ndarray:
        return (A @ state.reshape(shape) + drive).ravel()

    found = solve_ivp(slope, (0.0, loop.T), x.ravel(), method=method, rtol=rtol, atol=1e-3 * rtol)
    return found.y[:, -1].reshape(shape)


def _rubbing(x: np.ndarray, tau: np.ndarray, loop: _Loop, method: str, rtol: float) -> np.ndarray:
    """One sample with Coulomb friction: an event ends every stretch of sliding or standing."""
    state, torque = x[:, 0].copy(), tau[:, 0]
    now = 0.0
    sense = np.zeros(2)
    for j in range(2):
        sense[j] = (
            np.sign(state[4 + j]) if abs(state[4 + j]) > 1e-12 else _leaves(state, torque, loop, j)
        )
    while now < loop.T:
        standing = sense == 0
        A, drive = loop.A.copy(), loop.B @ (torque - sense * COULOMB)
        A[4:6][standing] = 0.0
        drive[4:6][standing] = 0.0
        A[:2, 4:6][:, standing] = 0.0

        def slope(_t: float, s: np.ndarray, A: np.ndarray = A, drive: np.ndarray = drive) -> np.ndarray:
            return A @ s + drive

        events = [_event(j, bool(standing[j]), torque, loop, float(sense[j])) for j in range(2)]
        found = solve_ivp(
            slope, (now, loop.T), state, method=method, rtol=rtol, atol=1e-3 * rtol, events=events
        )
        state, now = found.y[:, -1].copy(), float(found.t[-1])
        for j in range(2):
            if found.status == 1 and found.t_events[j].size:
                state[4 + j] = 0.0
                sense[j] = _leaves(state, torque, loop, j)
    return state[:, None]


def _load(state: np.ndarray, torque: np.ndarray, loop: _Loop, j: int) -> float:
    """Torque on motor j but for Coulomb friction."""
    return float(INERTIA.M[j] * (loop.A[4 + j] @ state) + torque[j])


def _leaves(state: np.ndarray, torque: np.ndarray, loop: _Loop, j: int) -> float:
    """Which way a motor at rest starts; 0 where friction holds it."""
    load = _load(state, torque, loop, j)
    return float(np.sign(load)) if abs(load) > COULOMB[j] * (1 + 1e-9) else 0.0


def _event(
    j: int, standing: bool, torque: np.ndarray, loop: _Loop, sense: float
) -> Callable[..., float]:
    if standing:

        def event(_t: float, s: np.ndarray) -> float:
            return COULOMB[j] * (1 + 2e-9) - abs(_load(s, torque, loop, j))

    else:

        def event(_t: float, s: np.ndarray) -> float:
            # A motor that just left rest has velocity 0 and would meet its own event.
            return sense * s[4 + j] + 1e-13

    event.terminal = True  # type: ignore[attr-defined]
    event.direction = -1.0  # type: ignore[attr-defined]
    return event


def _robot(quick: bool) -> Table:
    rows: list[dict[str, Cell]] = []
    frequencies = np.array([17.0, 25.0]) if quick else np.geomspace(3.0, 30.0, 6)
    for friction in (False, True):
        seconds = 0.06 if quick else (0.4 if friction else 1.0)
        experiment = Experiment(frequencies, seconds, friction)
        exact = experiment.by_solve_ivp("DOP853", 1e-12)
        size = np.abs(exact).max(axis=0)
        loose = ("RK45", 1e-4) if friction else ("DOP853", 1e-11)
        calls = {
            "**jointid** simulate_records": experiment.by_jointid,
            f"scipy solve_ivp, {loose[0]}, rtol {loose[1]:g}": lambda e=experiment, x=loose: (
                e.by_solve_ivp(*x)
            ),
        }
        errors = {name: (np.abs(call() - exact) / size).max() for name, call in calls.items()}
        times = interleaved(
            calls, against="**jointid** simulate_records", rounds=2 if quick else 5, warm=False
        )
        for name, each in times.items():
            rows.append(
                {
                    "simulator": name,
                    "friction": "0.4 and 0.08 N·m" if friction else "none",
                    "median": each.median,
                    "spread": each.spread,
                    "× jointid": each.ratio,
                    "largest error of an angle": errors[name],
                }
            )
    title = f"The simulated robot, {2 * frequencies.size} records in closed loop at 1 kHz"
    return Table("simulation", title, ROBOT_COLUMNS, tuple(rows), (NOTE,))


NOTE = (
    "Error: largest over the record, relative to the amplitude, from a solve_ivp run (DOP853) at "
    "rtol = 1e-12. solve_ivp starts anew at every control sample, where the torque jumps, and at every "
    "reversal and stop: its time hardly depends on rtol, and a looser one does not make it faster. "
    "Records without friction are 1 s long, those with friction 0.4 s."
)


def _cut(quick: bool) -> Table:
    arm, path = PlanarArm.example(), rectangle()
    run = track(arm, path, TRUTH, TRUTH)
    lasts = float(run.time_s[-1])
    side = 3 if quick else 20
    ratio = np.geomspace(1 / 3, 3, side)
    ratios = np.stack(np.meshgrid(ratio, ratio)).reshape(2, -1)
    timed = {
        "one cut in pymunk": lambda: track(arm, path, TRUTH, TRUTH),
        f"{side} × {side} mismatches": lambda: errors_of_mismatch(arm, path, TRUTH, ratios),
    }
    one, many = timed
    times = interleaved(timed, against=one, rounds=2 if quick else 7, warm=False)
    per_run = times[many].median / side**2
    remarks = {
        one: f"{lasts / times[one].median:.0f} × faster than the cut itself, which takes {lasts:.2f} s",
        many: f"{1e3 * per_run:.2f} ms per cut, "
        f"{side**2 / times[many].ratio:.1f} × faster than one by one",
    }
    rows: list[dict[str, Cell]] = [
        {"what": name, "median": each.median, "spread": each.spread, "remark": remarks[name]}
        for name, each in times.items()
    ]
    return Table("cut", "The cut, in steps of 0.25 ms", CUT_COLUMNS, tuple(rows))
