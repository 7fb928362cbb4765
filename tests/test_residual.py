"""The residual of the fit: zero for robots that have its effects, with correct derivatives."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from plants import PARALLELOGRAM, SERIAL, exact_phasors

from jointid import Inertia, JointIdError
from jointid.arrays import Floats
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.levenberg_marquardt import penalty, quadratic
from jointid.estimation.estimators.noise import Noise
from jointid.estimation.estimators.parameters import EFFECTS as EVERY
from jointid.estimation.estimators.parameters import ParameterLayout, Parameters
from jointid.estimation.estimators.problem import Problem, fitted_layout, make_problem
from jointid.estimation.estimators.residual import Residual

HZ, H, n = np.array([3.0, 7.0, 12.0, 25.0] * 2), 3, 2
POSES = [PARALLELOGRAM] * 4 + [SERIAL] * 4
TRUE = {
    "K": [43.0, 7.5], "D": [0.10, 0.015], "viscous": [0.01, 0.02], "arm_viscous": [0.03, 0.01],
    "loss_factor": [0.05, 0.1], "stiffness_change": [0.1, -0.05], "stiffness_change_2": [0.02, 0.1],
    "stiffness_change_3": [0.1, -0.05], "damping_change": [-0.3, 0.2], "damping_change_2": [0.1, 0.03],
    "damping_change_3": [0.03, -0.02],
    "lag": [3e-4, 1e-3], "position_filter": [1e-3, 5e-4],
    "torque_filter": [4e-4, 2e-3], "link": [2e-8, 1e-8], "gravity": [3.0, -1.0],
    "torque_scale": [1.1, 0.8],
}  # fmt: skip
EFFECTS = tuple(name for name in TRUE if name in EVERY)
PLACE = np.linspace(-1, 1, 8)
SLOW = np.array([PLACE, 1.5 * PLACE**2 - 0.5, 2.5 * PLACE**3 - 1.5 * PLACE]) / 2
SLOW -= SLOW.mean(axis=1, keepdims=True)


def logged(p: Parameters) -> np.ndarray:
    """Logs z (r, H, 2n) of robots whose motors move anyhow: one matrix equation for each line."""
    rng = np.random.default_rng(1)
    motor = rng.standard_normal((8, H, n)) + 1j * rng.standard_normal((8, H, n))
    z = np.zeros((8, H, 2 * n), complex)
    reference = np.exp(np.log(2 * np.pi * HZ).mean())
    for r, h in np.ndindex(8, H):
        s = 2j * np.pi * HZ[r] * (h + 1)
        loss = p.effect("loss_factor") * (1j + 2 / np.pi * np.log(abs(s) / reference))
        K, D = (
            1
            + sum(
                slow * p.effect(f"{of}_change{k}")
                for k, slow in zip(("", "_2", "_3"), SLOW[:, r], strict=True)
            )
            for of in ("stiffness", "damping")
        )
        gear = np.diag(p.K * (K + loss) + s * p.D * D)
        own = s * p.effect("arm_viscous") + p.effect("gravity") - s**4 * p.effect("link")
        arm = s**2 * POSES[r].M2 + np.diag(own * np.ones(n))
        q = motor[r, h]
        angle = np.linalg.solve(arm + gear, gear @ q)  # (A + κ) q_a = κ q
        acting = s**2 * POSES[r].M * q + s * p.effect("viscous") * q + gear @ (q - angle)
        late = np.exp(-s * (p.effect("lag") + p.delay)) / (1 + s * p.effect("torque_filter"))
        z[r, h] = np.r_[q / (1 + s * p.effect("position_filter")), acting / (late * p.torque_scale)]
    return z


def problem_of(
    effects: tuple[str, ...], *, delay: float = 0.0, std: float = 0.0
) -> tuple[Problem, Floats]:
    """The problem of these logs, with inertias that are given wrongly, and the true parameters."""
    given = [Inertia(0.9 * each.M, 1.1 * each.M2) for each in POSES] if std else POSES
    prior = InertiaPrior.of(given, 8, n, inertia_std=std, torque_std=std)
    layout = fitted_layout(prior, None, bool(delay), effects)
    values = {name: value for name, value in TRUE.items() if name in layout}
    if std:
        lower = np.tril_indices(n)
        values |= {"M": POSES[0].M, "M2": [POSES[0].M2[lower], POSES[4].M2[lower]]}
    values |= {"delay": delay} if delay else {}
    p = layout.named(layout.pack(**values))
    z = logged(p)
    rng = np.random.default_rng(2)
    root = rng.standard_normal((8, H, 2 * n, 2 * n)) + 1j * rng.standard_normal((8, H, 2 * n, 2 * n))
    root *= [[1e-6], [1e-6], [1e-3], [1e-3]]
    covariance = root @ root.conj().swapaxes(2, 3)
    phasors = replace(
        exact_phasors(HZ, z[:, 0, :n], z[:, 0, n:]),
        harmonics=z, harmonic_covariance=covariance, harmonic_rounding=np.zeros(z.shape),
    )  # fmt: skip
    noise = Noise(covariance, np.full(8, 1e6))
    return make_problem(phasors, prior, layout, p, None, noise), p.vector


CASES = [((), 0.0, 0.0), (EFFECTS, 0.0, 0.2), (("position_filter", "link"), 2e-3, 0.0)]


@pytest.mark.parametrize(("effects", "delay", "std"), CASES)
def test_a_robot_with_effects_leaves_no_residual(
    effects: tuple[str, ...], delay: float, std: float
) -> None:
    """Which is linear in the logs: its covariance follows from theirs."""
    problem, p = problem_of(effects, delay=delay, std=std)
    found = Residual.at(problem, p)
    assert np.abs(found.r).max() < 1e-10 * np.abs(found.torque).max()
    change = np.random.default_rng(3).standard_normal(problem.z.shape) * [1e-3, 1e-3, 1.0, 1.0]
    moved = Residual.at(replace(problem, z=problem.z + change), p)
    np.testing.assert_allclose(moved.r, (found.E @ change[..., None])[..., 0], atol=1e-9)
    V = found.E @ problem.noise.covariance @ found.E.conj().swapaxes(2, 3)
    np.testing.assert_allclose(found.V, V, atol=1e-9 * np.abs(V).max())
    if not effects:
        np.testing.assert_allclose(found.ideal_torque(), problem.z[:, :1, n:], rtol=1e-9)


@pytest.mark.parametrize(("effects", "delay", "std"), CASES)
def test_the_jacobian_is_that_of_the_residual(
    effects: tuple[str, ...], delay: float, std: float
) -> None:
    problem, p = problem_of(effects, delay=delay, std=std)
    p = 1.03 * p
    J = Residual.at(problem, p).jacobian(problem.z)
    for k, label in enumerate(problem.layout.labels):
        step = 1e-5 * p[k] * np.eye(p.size)[k]
        ahead, behind = (Residual.at(problem, p + sign * step).r for sign in (1, -1))
        column = (ahead - behind) / (2 * step[k])
        assert np.linalg.norm(J[..., k] - column) < 1e-7 * np.linalg.norm(column), label


@pytest.mark.parametrize(
    ("name", "possible", "impossible"),
    [
        ("K", 99.0, 101.0),
        ("K", 1e-6, 0.0),
        ("D", -1.0, None),
        ("M", 1e-6, 0.0),
        ("torque_scale", 1e-6, -1e-6),
    ],
)
def test_a_fit_stays_where_robots_are_possible(
    name: str, possible: float, impossible: float | None
) -> None:
    """K up to a hundred times the start; inertias and torque scales are positive."""
    problem, p = problem_of(EFFECTS, std=0.2)
    place = problem.layout[name].stop - 1
    for share, wanted in ((possible, True), (impossible, False)):
        if share is not None:
            assert problem.feasible(np.where(np.arange(p.size) == place, share * p, p)) == wanted


def test_an_arm_inertia_is_positive_definite() -> None:
    problem, p = problem_of((), std=0.2)
    first = problem.layout["M2"].start  # M2_11, M2_21, M2_22 of the first pose
    limit = np.sqrt(p[first] * p[first + 2])
    for share in (-1.01, -0.99, 0.99, 1.01):
        p[first + 1] = share * limit
        assert problem.feasible(p) == (abs(share) < 1)


def test_the_prior_pulls_inertias_torque_scales_and_links_by_their_errors() -> None:
    problem, p = problem_of(EFFECTS, std=0.2)
    deviation, weight = problem.prior_residual(p)
    layout, units = problem.layout, problem.prior.units
    expected = {
        "M": (POSES[0].M * 0.1, 0.2 * units["M"]),
        "torque_scale": ([0.1, -0.2], [0.2, 0.2]),
        "link": (TRUE["link"], problem.link_std),
    }
    for name, (off, std) in expected.items():
        np.testing.assert_allclose(deviation[layout[name]], np.ravel(off))
        np.testing.assert_allclose(np.diag(weight)[layout[name]], np.ravel(std) ** -2.0)
    of_M2 = deviation[layout["M2"]].reshape(2, 3)
    np.testing.assert_allclose(of_M2, -0.1 * np.array([m.M2[np.tril_indices(n)] for m in POSES[::4]]))
    assert not deviation[layout["K"]].any()
    assert not weight[layout["gravity"]].any()
    assert problem.rows == 2 * 8 * H * n
    assert problem.highest_rad_s == pytest.approx(50 * np.pi)


def test_a_filter_starts_beside_a_delay_that_it_shortens() -> None:
    """With 0.3 of the delay, or a twentieth of the shortest period over 2π if that is more."""
    problem, p = problem_of(("position_filter",), delay=2e-3)
    without = ParameterLayout.of(n, delay=True)
    for delay, T in ((0.02, 6e-3), (1e-5, 0.05 / (50 * np.pi))):
        start = without.named(without.pack(K=TRUE["K"], D=TRUE["D"], delay=delay))
        found = problem.layout.named(problem.start(start))
        np.testing.assert_allclose(found["position_filter"], T)
        assert found.delay == pytest.approx(delay - T)
        assert found.K.tolist() == TRUE["K"]
    shorter = problem.layout.named(problem.start(start, 0.01))
    np.testing.assert_allclose(shorter["position_filter"], 0.01 / (50 * np.pi))
    np.testing.assert_array_equal(problem.start(problem.layout.named(p)), p)  # all of it is given


def test_frictions_losses_gaps_and_masses_are_not_negative() -> None:
    """Timing, gravity and changes of stiffness have either sign."""
    positive = {name for name, effect in EVERY.items() if effect.positive}
    assert positive == {
        "viscous", "arm_viscous", "arm_coulomb", "loss_factor", "load", "motor_presliding", "link",
        "backlash", "hysteresis",
    }  # fmt: skip


def test_gears_stay_within_the_range_that_records_can_show() -> None:
    """Of their units: shapes from 1e-4 to 2, gaps and loops up to 4; slopes of at least a tenth of K."""
    effects = ("piecewise", "backlash", "hysteresis")
    layout = ParameterLayout.of(n, effects=effects)
    names = ("knee", "second_knee", "presliding", "backlash", "hysteresis")
    units = {name: np.array([0.5, 2.0]) * (k + 1) for k, name in enumerate(names)}
    usual = {name: 0.3 * unit for name, unit in units.items()} | {"K": [40.0, 10.0], "D": [-1.0, 1.0]}
    laws: Any = SimpleNamespace(motors=None, units=lambda p: units)
    problem = replace(problem_of(())[0], layout=layout, laws=laws)

    def possible(**changed: Any) -> bool:
        return problem.feasible(layout.pack(**{**usual, **changed}))

    assert possible()
    for name, unit in units.items():
        low, high = (-4.0, 4.0) if name in ("backlash", "hysteresis") else (1e-4, 2.0)
        for j in range(n):
            for share in (low + 1e-5, low - 1e-5, high - 1e-5, high + 1e-5):
                value = np.where(np.arange(n) == j, share, 0.3) * unit
                assert possible(**{name: value}) == (low < share < high), (name, share)
    assert possible(piecewise=[-35.9, 0], second_bend=[0, 0])
    assert not possible(piecewise=[-36.1, 0], second_bend=[0, 0])
    assert not possible(piecewise=[-20.0, 0], second_bend=[-16.1, 0])
    assert possible(piecewise=[-20.0, 0], second_bend=[-15.9, 0])
    laws.motors = object()  # arms that are followed over time
    assert not possible()
    assert possible(D=[1.0, 1.0])


def test_the_cost_of_a_linear_residual_is_its_parabola_with_the_prior() -> None:
    """Rows and half the prior's square: exact at any distance."""
    rng = np.random.default_rng(5)
    J, left, root = rng.standard_normal((7, 3)), rng.standard_normal(7), rng.standard_normal((3, 3))
    weight, mean = root @ root.T, rng.standard_normal(3)
    problem: Any = SimpleNamespace(prior_residual=lambda p: (p - mean, weight))

    def at(p: Floats) -> Any:
        return SimpleNamespace(at=SimpleNamespace(problem=problem), rows=left + J @ p, columns=lambda: J)

    p, step = rng.standard_normal((2, 3))
    cost, gradient, normal = quadratic(at(p), p)
    there, *_ = quadratic(at(p + step), p + step)
    assert there == pytest.approx(cost + 2 * gradient @ step + step @ normal @ step)
    assert penalty(problem, p) == pytest.approx(0.5 * np.sum((root.T @ (p - mean)) ** 2))
    assert cost == pytest.approx(np.sum((left + J @ p) ** 2) + penalty(problem, p))


def test_a_hardening_gear_with_friction_at_the_arm_leaves_no_residual() -> None:
    """An arm in a sine rubs as a square wave; the gear yields to the torque; the motor moves both."""
    M, M2, K, cubic, coulomb, H, N = 2.5e-3, 4.1e-3, 43.0, 3e4, 0.05, 41, 4096
    layout = ParameterLayout.of(1, effects=("cubic", "arm_coulomb"))
    p = layout.named(layout.pack(K=[K], D=[0.0], cubic=[cubic], arm_coulomb=[coulomb]))
    hz, phase = np.array([6.0, 9.0]), 2 * np.pi * (np.arange(N) + 0.5) / N
    z = np.zeros((2, H, 2), complex)
    for r, omega in enumerate(2 * np.pi * hz):
        arm = 1.2 / (M2 * omega**2) * np.sin(phase)
        through = -(omega**2) * M2 * arm + coulomb * np.sign(np.cos(phase))
        bent = np.linspace(-0.05, 0.05, 20_001)
        wound = np.interp(through, K * bent + cubic * bent**3, bent)
        orders = np.arange(1, H + 1)
        of_motor, of_gear = (
            2j / N * np.exp(-1j * np.outer(orders, phase)) @ wave for wave in (arm + wound, through)
        )
        z[r] = np.stack([of_motor, of_gear - (omega * orders) ** 2 * M * of_motor], axis=1)
    covariance = np.tile(np.diag([1e-12, 1e-8]).astype(complex), (2, H, 1, 1))
    phasors = replace(
        exact_phasors(hz, z[:, 0, :1], z[:, 0, 1:]),
        harmonics=z, harmonic_covariance=covariance, harmonic_rounding=np.zeros(z.shape),
    )  # fmt: skip
    prior = InertiaPrior.of(Inertia([M], [[M2]]), 2, 1)
    noise = Noise(covariance, np.full(2, 1e6))
    problem = make_problem(phasors, prior, layout, p, None, noise)
    found = Residual.at(problem, p.vector)
    assert np.abs(found.r[:, :5]).max() < 0.03 * coulomb
    J = found.jacobian(problem.z)
    for k in (0, 2, 3):  # far enough that the solution's tolerance of a millionth does not count
        step = 1e-2 * p.vector[k] * np.eye(4)[k]
        ahead, behind = (Residual.at(problem, p.vector + sign * step).r for sign in (1, -1))
        column = (ahead - behind) / (2 * step[k])
        assert np.linalg.norm(J[..., k] - column) < 0.01 * np.linalg.norm(column), layout.labels[k]


def test_a_negative_stiffness_is_no_start() -> None:
    layout, prior = ParameterLayout.of(n), InertiaPrior.of(SERIAL, 1, n)
    phasors = exact_phasors(HZ[:1], np.ones((1, n)), np.ones((1, n)))
    noise = Noise(phasors.harmonic_covariance, np.full(1, 9.0))
    for K in ([43.0, -7.5], [43.0, 0.0]):
        start = layout.named(layout.pack(K=K, D=[0.1, 0.1]))
        with pytest.raises(JointIdError, match="K2 is negative by least squares"):
            make_problem(phasors, prior, layout, start, None, noise)


def test_a_law_starts_at_shares_of_the_largest_deflection_and_of_a_cubic_law() -> None:
    layout = ParameterLayout.of(n, effects=("piecewise", "hysteresis"))
    unit = np.array([0.02, 0.05])
    units = {"knee": unit, "second_knee": 2 * unit, "presliding": 3 * unit}
    laws: Any = SimpleNamespace(motors=None, units=lambda p: units)
    problem = replace(problem_of(())[0], layout=layout, laws=laws)
    cubic = ParameterLayout.of(n, effects=["cubic"])
    given = cubic.named(cubic.pack(K=[40.0, 10.0], D=[0.1, 0.2], cubic=[9e3, 100.0]))
    found = layout.named(problem.start(given))
    np.testing.assert_allclose(found["knee"], 0.35 * unit)
    np.testing.assert_allclose(found["second_knee"], 0.7 * unit)
    np.testing.assert_allclose(found["presliding"], 0.09 * unit)
    rise = given["cubic"] * unit**2
    np.testing.assert_allclose([found["piecewise"], found["second_bend"]], [0.73 * rise, 1.33 * rise])
    np.testing.assert_array_equal([found.K, found.D], [given.K, given.D])


def test_the_jacobian_of_presliding_friction_is_that_of_the_residual() -> None:
    """Of a level and an angle, before the filters and lags of their logs."""
    effects = ("position_filter", "motor_presliding", "lag")
    problem, _ = problem_of(("position_filter", "lag"))
    layout, values = ParameterLayout.of(n, effects=effects), dict(TRUE)
    start = layout.named(
        layout.pack(
            motor_presliding=[0.1, 0.2], bristle=[0.3, 0.2],
            **{name: values[name] for name in ("K", "D", "position_filter", "lag")},
        )
    )  # fmt: skip
    prior = InertiaPrior.of(POSES, 8, n)
    phasors = replace(
        exact_phasors(HZ, problem.z[:, 0, :n], problem.z[:, 0, n:]),
        harmonics=problem.z, harmonic_covariance=problem.noise.covariance,
        harmonic_rounding=np.zeros(problem.z.shape),
    )  # fmt: skip
    problem = make_problem(phasors, prior, layout, start, None, problem.noise)
    J = Residual.at(problem, start.vector).jacobian(problem.z)
    for k in range(layout["motor_presliding"].start, layout["bristle"].stop):
        step = 1e-3 * start.vector[k] * np.eye(layout.size)[k]
        ahead, behind = (Residual.at(problem, start.vector + sign * step).r for sign in (1, -1))
        column = (ahead - behind) / (2 * step[k])
        size = np.linalg.norm(column)
        assert np.linalg.norm(J[..., k] - column) < 0.01 * size, layout.labels[k]


def test_motions_with_exact_derivatives_have_no_terms_of_the_ends() -> None:
    """Torques by velocity and acceleration are those by the angles; a motor at rest keeps its own."""
    problem, p = problem_of(("viscous", "position_filter"))
    plain = Residual.at(problem, p)
    torque, angle = plain.without_ends()
    s = problem.s[..., None]
    motion = np.stack([s * angle, s * s * angle])
    motion[:, 0] = 0.0
    at = replace(plain, problem=replace(problem, motion=motion))
    found = at.without_ends()
    np.testing.assert_allclose(found[0], torque, atol=1e-9 * np.abs(torque).max())
    np.testing.assert_allclose(found[1], angle, rtol=1e-9)
    off = replace(plain, problem=replace(problem, motion=1.1 * motion)).without_ends()
    own = problem.layout.named(p)
    less = 0.1 * (s * s * PARALLELOGRAM.M + s * own["viscous"]) * angle
    np.testing.assert_allclose(off[0][1:4], (torque - less)[1:4], rtol=1e-9)
