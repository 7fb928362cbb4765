"""Equations (8)-(15): exact without noise, calibrated errors with noise, clear refusals."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plants import (
    BAND_HZ,
    PAPER,
    PARALLELOGRAM,
    ROBOTS,
    SERIAL,
    THREE,
    campaign,
    circular,
    estimated,
    exact_phasors,
    motion,
    noisy,
    plant_phasors,
    random_covariance,
    steady_records,
)
from random_cases import examples, tries

from jointid import (
    Elasticity,
    ElasticityFit,
    Inertia,
    JointIdError,
    Phasors,
    SineRecord,
    extract_phasors,
    identify_elasticity,
    spring_equations,
)
from jointid.estimation import elasticity as elasticity_module
from jointid.estimation.elasticity import likelihood_fit, undetermined
from jointid.estimation.estimators.held_torque import HeldTorque
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.joint_equations import SpringEquations
from jointid.estimation.estimators.linear_fit import (
    explicit,
    least_squares,
    prior_covariance,
    prior_slopes,
    weighted,
)
from jointid.estimation.estimators.noise import Noise, moderated_noise
from jointid.estimation.estimators.parameters import ParameterLayout

LINEAR = ["least-squares", "explicit", "weighted"]


def answer(fit: ElasticityFit) -> np.ndarray:
    return np.concatenate([fit.K, fit.D])


def truth(n: int) -> np.ndarray:
    return np.concatenate([ROBOTS[n][1].K, ROBOTS[n][1].D])


def example(n: int = 2, frequencies: np.ndarray = BAND_HZ, count: int | None = None) -> Phasors:
    return plant_phasors(*ROBOTS[n], *campaign(frequencies, n, count))


def mild_noise(phasors: Phasors, level: float = 1e-3, unlike: float = 1.0) -> np.ndarray:
    """Strongly correlated noise, in size alike in every record up to a factor ``unlike``."""
    scale = level * np.abs(phasors.z).min(axis=0)
    rng = np.random.default_rng(0)
    louder = unlike ** rng.uniform(-1, 1, phasors.omega.size)
    return np.array([random_covariance(rng, factor * scale) for factor in louder])


# Without noise


@pytest.mark.parametrize("method", LINEAR)
@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("count", [1, 2, 5])
def test_without_noise_the_estimate_is_exact(method: str, n: int, count: int) -> None:
    fit = identify_elasticity(example(n, count=count), ROBOTS[n][0], method=method)
    assert np.allclose(answer(fit), truth(n), rtol=1e-9)
    assert np.allclose(fit.elasticity.K, ROBOTS[n][1].K, rtol=1e-9)
    assert fit.method == method


@pytest.mark.parametrize("method", LINEAR)
@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("frequency", [4.0, 17.0])
def test_one_record_is_enough(method: str, n: int, frequency: float) -> None:
    """All joints move in it: 2n parameters from n complex equations."""
    fit = identify_elasticity(example(n, np.array([frequency]), 1), ROBOTS[n][0], method=method)
    assert np.allclose(answer(fit), truth(n), rtol=1e-8)
    assert fit.misfit == 1.0
    assert np.isfinite(fit.standard_error).all()


@pytest.mark.parametrize("method", LINEAR)
@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("periods", [1.0, 6.37, 10.0])
def test_the_estimate_is_exact_for_records_of_any_length(method: str, n: int, periods: float) -> None:
    inertia, elasticity = ROBOTS[n]
    records = steady_records(
        inertia, elasticity, *campaign(BAND_HZ, n),
        periods=periods, hold=True, delay_s=0.0013, offset=2.0, begin_s=4.4,
    )  # fmt: skip
    fit = identify_elasticity(extract_phasors(records), inertia, method=method)
    assert np.allclose(answer(fit), truth(n), rtol=1e-6)


@examples(40)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(1, 4),
    method=st.sampled_from(LINEAR),
)
def test_any_robot_is_identified(seed: int, n: int, method: str) -> None:
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((n, n)) + 2 * np.eye(n)
    inertia = Inertia(M=rng.uniform(0.001, 0.005, n), M2=0.003 * (root @ root.T + 0.3 * np.eye(n)))
    elasticity = Elasticity(K=rng.uniform(5, 80, n), D=rng.uniform(0, 0.2, n))
    phasors = plant_phasors(inertia, elasticity, *campaign(BAND_HZ, n))
    fit = identify_elasticity(phasors, inertia, method=method)
    assert np.allclose(fit.K, elasticity.K, rtol=1e-7)
    assert np.allclose(fit.D, elasticity.D, rtol=1e-6, atol=1e-8)


def test_undamped_joint_gives_a_usable_answer() -> None:
    stiff = Elasticity(K=PAPER.K, D=[0.0, 0.0])
    fit = identify_elasticity(plant_phasors(SERIAL, stiff, *campaign(BAND_HZ, 2)), SERIAL)
    assert np.allclose(fit.elasticity.D, 0, atol=1e-9)


def test_poses_have_their_own_inertia_and_one_elasticity() -> None:
    frequencies, torques = campaign(BAND_HZ, 2)
    poses = [SERIAL, PARALLELOGRAM, Inertia(M=SERIAL.M, M2=[[0.0081, 0.0021], [0.0021, 0.0019]])]
    inertias = [poses[i % 3] for i in range(frequencies.size)]
    q = np.vstack(
        [
            motion(inertia, PAPER, frequencies[i : i + 1], torques[i : i + 1])
            for i, inertia in enumerate(inertias)
        ]
    )
    phasors = exact_phasors(frequencies, q, torques)
    for method in LINEAR:
        fit = identify_elasticity(phasors, inertias, method=method)
        assert np.allclose(answer(fit), truth(2), rtol=1e-8)
        wrong = identify_elasticity(phasors, SERIAL, method=method)
        assert not np.allclose(answer(wrong), truth(2), rtol=1e-2)
        assert wrong.misfit > 100


# The paper's formulas


def scattered() -> Phasors:
    """Noisy phasors, so that the estimators differ."""
    base = example()
    noise = mild_noise(base, 0.02)
    return noisy(base, noise, circular(np.random.default_rng(1), noise, 1)[0])


def test_equations_9_and_11_written_out() -> None:
    phasors = scattered()
    equations = spring_equations(phasors, SERIAL)
    for r, omega in enumerate(phasors.omega):
        s = 1j * omega
        M, inverse = np.diag(SERIAL.M), np.linalg.inv(SERIAL.M2)
        a = (np.eye(2) + inverse @ M) @ (s**2 * phasors.q[r]) - inverse @ phasors.tau[r]
        b = s**2 * phasors.tau[r] - M @ (s**4 * phasors.q[r])
        assert np.allclose(equations.a[r], a, rtol=1e-10)
        assert np.allclose(equations.b[r], b, rtol=1e-10)


def test_deflection_and_spring_torque_are_those_of_the_arm() -> None:
    """The spring's torque is what moves the arm: τ − M s² q = M2 s² qa."""
    phasors = example()
    equations = spring_equations(phasors, SERIAL)
    s2 = -(phasors.omega[:, None] ** 2)
    arm = (phasors.tau - SERIAL.M * s2 * phasors.q) @ np.linalg.inv(SERIAL.M2) / s2
    assert np.allclose(equations.deflection, phasors.q - arm, rtol=1e-9)
    assert np.allclose(equations.spring_torque, phasors.tau - SERIAL.M * s2 * phasors.q, rtol=1e-9)
    expected = PAPER.K + 1j * phasors.omega[:, None] * PAPER.D
    assert np.allclose(equations.stiffness, expected, rtol=1e-8)
    assert np.allclose(equations.spring_torque, expected * equations.deflection, rtol=1e-8)


def test_least_squares_is_the_pseudo_inverse_of_equation_13() -> None:
    phasors = scattered()
    fit = identify_elasticity(phasors, SERIAL, method="least-squares")
    A, b = fit.equations.matrix()
    assert A.shape == (4 * phasors.omega.size, 4)
    D1, K1, D2, K2 = np.linalg.pinv(A) @ b
    assert np.allclose(answer(fit), [K1, K2, D1, D2], rtol=1e-9)


def test_matrix_has_the_rows_of_equation_12() -> None:
    phasors = scattered()
    equations = spring_equations(phasors, SERIAL)
    A, b = equations.matrix()
    w, (a1, a2), (b1, b2) = phasors.omega[3], equations.a[3], equations.b[3]
    assert np.allclose(
        A[12:16],
        [
            [-w * a1.imag, a1.real, 0, 0],
            [w * a1.real, a1.imag, 0, 0],
            [0, 0, -w * a2.imag, a2.real],
            [0, 0, w * a2.real, a2.imag],
        ],
    )
    assert np.allclose(b[12:16], [b1.real, b1.imag, b2.real, b2.imag])


def test_explicit_is_equation_15_as_printed() -> None:
    phasors = scattered()
    fit = identify_elasticity(phasors, SERIAL, method="explicit")
    w, equations = phasors.omega, fit.equations
    for j in range(2):
        a, b = equations.a[:, j], equations.b[:, j]
        D = -np.sum(a.imag * b.real - a.real * b.imag) / np.sum(w * (a.real**2 + a.imag**2))
        K = np.sum(a.real * b.real + a.imag * b.imag) / np.sum(a.real**2 + a.imag**2)
        assert [fit.K[j], fit.D[j]] == pytest.approx([K, D], rel=1e-10)


def test_equations_13_and_15_agree_for_one_frequency_and_on_K() -> None:
    phasors = scattered()
    pinv, printed = (identify_elasticity(phasors, SERIAL, method=m) for m in LINEAR[:2])
    assert np.allclose(pinv.K, printed.K, rtol=1e-12)
    assert not np.allclose(pinv.D, printed.D, rtol=1e-5)
    one = phasors.select([4, 5])  # two records of one frequency
    pinv, printed = (identify_elasticity(one, SERIAL, method=m) for m in LINEAR[:2])
    assert np.allclose(answer(pinv), answer(printed), rtol=1e-10)


@pytest.mark.parametrize("method", ["auto", *LINEAR])
def test_held_torque_at_a_low_sample_rate(method: str) -> None:
    """The gear takes part in the motion between the samples; a rotor alone makes D 0.02 % wrong."""
    f, torques = campaign(BAND_HZ, 2)
    noise = (1e-8, 1e-6)
    records = steady_records(SERIAL, PAPER, f, torques, sample_rate_hz=250.0, hold=True, noise=noise)
    fit = identify_elasticity(extract_phasors(records), SERIAL, method=method)
    assert np.all(np.abs(answer(fit) - truth(2)) < 4 * fit.standard_error)
    assert np.allclose(answer(fit), truth(2), rtol=2e-5)


@pytest.mark.parametrize(
    "filters", [{}, {"torque_filter": 4e-4}, {"position_filter": 3e-4}, {"torque_filter": -4e-4}]
)
def test_images_of_a_held_torque_are_those_of_the_whole_robot(filters: dict[str, float]) -> None:
    """Delays turn each image, filters attenuate it; the gear acts to third order."""
    M, M2, K, D, v = 0.0025, 0.0041, 43.0, 0.1, 0.05
    hold, stated, delay, lag = 1e-3, np.array([[2e-4], [0.0]]), 1e-4, 3e-4
    s, arm = 2j * np.pi * np.array([[5.0, 60.0, 501.0], [20.0, 150.0, 0.1]]), np.full((2, 1, 1), 1 / M2)
    layout = ParameterLayout.of(1, delay=True, effects=["viscous", "lag", *filters])
    p = layout.named(layout.pack(K=K, D=D, viscous=v, delay=delay, lag=lag, **filters))
    held = HeldTorque.of(s, np.full(2, hold), stated[:, 0])
    found = held.images(p, s[..., None], np.full((2, 1), M), arm)[..., 0]
    k = np.concatenate([np.arange(-60, 0), np.arange(1, 61)])[:, None, None]
    at, T = s + 2j * np.pi * k / hold, max(filters.get("torque_filter", 0.0), 0.0)
    X = 1 / (1 / (K + at * D) + 1 / (at**2 * M2))
    angle = s / at / (at**2 * M + at * v + X) * (1 + s * T) / (1 + at * T)
    angle *= np.exp(-2j * np.pi * k * (stated + delay + lag) / hold)
    true = (angle / (1 + at * filters.get("position_filter", 0.0))).sum(axis=0)
    true[0, 2] = 0.0  # samples of a torque show no sine above half their rate
    np.testing.assert_allclose(found, true, rtol=2e-3)
    none = HeldTorque.of(s, np.zeros(2), stated[:, 0])
    assert not none.images(p, s[..., None], np.full((2, 1), M), arm).any()


@pytest.mark.parametrize("hold", [0.0, 1e-3])
def test_a_torque_is_filtered_before_it_acts_or_in_its_log(hold: float) -> None:
    """The log is filtered where the time constant is negative: of a held torque, from step to step."""
    s = 2j * np.pi * np.array([[5.0, 60.0]])
    held, T = HeldTorque.of(s, np.full(1, hold), np.zeros(1)), np.array([4e-4, -7e-4])
    layout = ParameterLayout.of(2, effects=["torque_filter"])
    gain = held.filter_gain(layout.named(layout.pack(K=1.0, D=1.0, torque_filter=T)), s[..., None])
    late = np.exp(-s * hold)  # of the log y of a torque x, y + T (y − y before)/hold = x
    logged = 1 + 7e-4 / hold * (1 - late) if hold else 1 + 7e-4 * s
    np.testing.assert_allclose(gain, np.stack([1 / (1 + 4e-4 * s), logged], axis=2), rtol=1e-12)


def test_weighted_is_generalised_least_squares() -> None:
    """Its normal equations hold for the inverse covariance of the errors, real and imaginary parts."""
    phasors = scattered()
    fit = identify_elasticity(phasors, SERIAL, method="weighted")
    A, b = fit.equations.matrix()
    A = A[:, [1, 3, 0, 2]]
    V = fit.equations.residual_covariance(fit.K, fit.D)
    weight = np.zeros((len(b), len(b)))
    for r, block in enumerate(np.linalg.inv(V)):
        i = 4 * r + np.array([0, 2])  # rows Re1, Im1, Re2, Im2
        weight[np.ix_(i, i)] = weight[np.ix_(i + 1, i + 1)] = block.real
        weight[np.ix_(i, i + 1)], weight[np.ix_(i + 1, i)] = -block.imag, block.imag
    expected = np.linalg.solve(A.T @ weight @ A, A.T @ weight @ b)
    error = 0.02 * fit.standard_error  # the weights hang on the answer; the last pass moves it little
    assert np.all(np.abs(answer(fit) - expected) < error)


def test_equations_of_the_robot_leave_what_noise_makes() -> None:
    """Residuals by the matrix of the signals; none of a record without motion, which is refused."""
    phasors = example()
    equations = spring_equations(phasors, SERIAL)
    K, D = PAPER.K, PAPER.D
    assert np.abs(equations.residual(K, D)).max() < 1e-8 * np.abs(equations.b).max()
    wrong = PAPER.K * [1.1, 0.9], PAPER.D * [0.9, 0.8]
    of_signals = (equations.residual_gain(*wrong) @ phasors.z[..., None])[..., 0]
    np.testing.assert_allclose(equations.residual(*wrong), of_signals, rtol=1e-9)
    none = np.zeros_like(equations.noise.covariance)
    still = replace(equations, noise=Noise(none, equations.noise.degrees_of_freedom))
    with pytest.raises(JointIdError, match="The motor of joint 1 does not move in a record"):
        still.residual_covariance(K, D)


@pytest.mark.parametrize("method", LINEAR)
def test_slopes_by_the_given_values_are_those_of_estimates_from_others(method: str) -> None:
    """Each inertia in its poses, the coupling included, and each torque scale."""
    phasors, poses = scattered(), [SERIAL] * 8 + [PARALLELOGRAM] * 6
    of = {"weighted": weighted, "least-squares": least_squares, "explicit": explicit}[method]
    noise = spring_equations(phasors, poses).noise
    prior = InertiaPrior.of(poses, 14, 2, inertia_std=0.1, torque_std=0.02)
    slopes, std = prior_slopes(method, phasors, prior, noise)
    expected = []
    for name, (mean, _) in prior.blocks().items():
        for k in range(mean.size):
            step = 1e-4 * np.where(np.arange(mean.size) == k, prior.units[name].ravel(), 0.0)
            ends = []
            for sign in (1, -1):
                value = (mean.ravel() + sign * step).reshape(mean.shape)
                M, M2 = prior.M, prior.M2
                M, M2 = (value if name == "M" else M), (prior.totals(value) if name == "M2" else M2)
                scale = value if name == "torque_scale" else np.ones(2)
                scaled = replace(phasors, tau=phasors.tau * scale)
                equations = spring_equations(scaled, prior.inertias(M, M2), noise=noise)
                of_torque = np.concatenate([np.ones(2), scale])  # the noise of the log is scaled, too
                equations = replace(
                    equations,
                    noise=replace(noise, covariance=noise.covariance * np.outer(of_torque, of_torque)),
                    leakage=equations.leakage * np.outer(of_torque, of_torque),
                )
                ends.append(of(equations).elasticity)
            expected.append((ends[0] - ends[1]) / (2 * step.sum()))
    assert slopes.shape == (4, 10)
    size = np.abs(slopes).max(axis=1, keepdims=True)
    np.testing.assert_allclose(slopes, np.transpose(expected), atol=2e-5 * size.max(), rtol=1e-3)
    np.testing.assert_allclose(
        prior_covariance(method, phasors, prior, noise), (slopes * std**2) @ slopes.T
    )


def test_only_weights_from_estimated_noise_cost_accuracy() -> None:
    """Least squares have no weights: half the complex covariance, however well that is known."""
    equations = spring_equations(scattered(), SERIAL)
    few, many = (
        replace(equations, noise=replace(equations.noise, degrees_of_freedom=np.full(14, freedom)))
        for freedom in (9.0, 1e9)
    )
    for method in (least_squares, explicit):
        known, guessed = method(many), method(few)
        np.testing.assert_allclose(known.covariance, guessed.covariance, rtol=1e-9)
        e = few.residual(*np.split(guessed.elasticity, 2))
        V = few.residual_covariance(*np.split(guessed.elasticity, 2)) * 9 / 7
        cost = np.einsum("ri,rij,rj->", e.conj(), np.linalg.inv(V), e).real
        assert guessed.cost == pytest.approx(cost, rel=1e-9)
    known, guessed = weighted(many), weighted(few)
    ratio = np.diag(guessed.covariance) / np.diag(known.covariance)
    assert np.all((ratio > 1.3) & (ratio < 81 / 48))
    # Of 28 complex equations four real parameters take the share of two.
    assert known.expected_cost == pytest.approx(26, rel=0.02)


# Noise


@pytest.fixture
def shared_equations(monkeypatch: pytest.MonkeyPatch) -> None:
    """The equations of the same data do not hang on the method: all three solve the same ones."""
    last: list[tuple[Phasors, SpringEquations]] = []

    def kept(phasors: Phasors, inertia: Inertia) -> SpringEquations:
        if not last or last[0][0] is not phasors:
            last[:] = [(phasors, spring_equations(phasors, inertia))]
        return last[0][1]

    monkeypatch.setattr("jointid.estimation.identify_elasticity.spring_equations", kept)


@pytest.mark.usefixtures("shared_equations")
@pytest.mark.parametrize(
    ("n", "count", "freedom", "unlike"),
    [
        (2, 2, 7, 1.0),
        (1, 2, 7, 4.0),
        *(
            pytest.param(*case, marks=pytest.mark.long)
            for case in (
                (1, 1, None, 1.0),
                (3, 3, None, 4.0),
                (1, 1, None, 4.0),
                (3, 3, None, 1.0),
                (2, 2, 15, 1.0),
                (2, 2, 15, 4.0),
                (2, 2, 7, 4.0),
                (1, 2, 7, 1.0),
            )
        ),
    ],
)
def test_standard_errors_are_the_scatter_of_the_estimates(
    n: int, count: int, freedom: int | None, unlike: float
) -> None:
    """320 realisations in a long run, a third in a normal one.

    ``freedom`` None knows the noise, else it is estimated from so many draws. The standard deviation of
    a variance ratio is 0.08: 0.7 to 1.35 is four of them. The misfit of a right model is 1 on average.
    Where the noise of the records differs by a factor of sixteen and only a few periods show it, the
    error may be stated up to 1.6 times too wide, never too narrow.
    """
    runs, base, inertia = tries(110, long=320), example(n, count=count), ROBOTS[n][0]
    noise = mild_noise(base, unlike=unlike)
    rng = np.random.default_rng(5)
    fits: dict[str, list[ElasticityFit]] = {method: [] for method in LINEAR}
    for error in circular(rng, noise, runs):
        stated = noise if freedom is None else estimated(rng, noise, freedom)
        data = noisy(base, stated, error, freedom or 1e9)
        for method, of_method in fits.items():
            of_method.append(identify_elasticity(data, inertia, method=method))
    moderated = unlike > 1 and freedom is not None
    for method, of_method in fits.items():
        found = np.array([answer(fit) for fit in of_method])
        # Inflation by a misfit above 1 is a safeguard on top; half of all right models are above 1.
        stated = np.mean([np.diag(fit.covariance) / max(1.0, fit.misfit) for fit in of_method], axis=0)
        ratio = found.var(axis=0) / stated
        assert np.all((ratio > (0.4 if moderated else 0.7)) & (ratio < 1.35)), (method, ratio)
        bias = (found.mean(axis=0) - truth(n)) / found.std(axis=0) * np.sqrt(runs)
        assert np.all(np.abs(bias) < 4.5), (method, bias)
        misfit = np.mean([fit.misfit for fit in of_method])
        assert (0.75 if moderated else 0.92) < misfit < 1.08, method


@pytest.mark.usefixtures("shared_equations")
def test_standard_errors_of_a_single_record_are_its_scatter() -> None:
    base = example(2, np.array([11.0]), 1)
    noise = mild_noise(base)
    fits: dict[str, list[ElasticityFit]] = {method: [] for method in LINEAR}
    for error in circular(np.random.default_rng(6), noise, tries(100, long=200, nightly=500)):
        data = noisy(base, noise, error)
        for method, of_method in fits.items():
            of_method.append(identify_elasticity(data, SERIAL, method=method))
    for method, of_method in fits.items():
        found = np.array([answer(fit) for fit in of_method])
        ratio = found.var(axis=0) / np.mean([np.diag(fit.covariance) for fit in of_method], axis=0)
        assert np.all((ratio > 0.78) & (ratio < 1.28)), (method, ratio)


def test_few_degrees_of_freedom_bias_an_inverse_and_equal_records_share_them() -> None:
    """Of 2 x 2 matrices of 9 draws, and of the noise of 14 records that have 7 draws each."""
    white = np.eye(2, dtype=complex)[None]
    rng = np.random.default_rng(3)
    drawn = np.concatenate([estimated(rng, white, 9) for _ in range(2000)])
    noise = Noise(np.eye(4, dtype=complex)[None, None], np.full(1, 9.0))
    assert np.linalg.inv(drawn).mean(axis=0)[0, 0].real == pytest.approx(noise.inverse_bias[0], rel=0.03)
    base = example()
    stated = estimated(rng, mild_noise(base), 7)
    known = np.repeat(SERIAL.M[None], 14, axis=0), np.repeat(np.linalg.inv(SERIAL.M2)[None], 14, axis=0)
    shared = moderated_noise(noisy(base, stated, 0 * base.z, 7), *known, PAPER.K, PAPER.D)
    assert shared.degrees_of_freedom.min() > 14


def test_maximum_likelihood_is_unbiased_where_weighting_is_not() -> None:
    """Noise in the deflection biases a linear fit, but not one with errors in variables."""
    base = example()
    noise = mild_noise(base, 0.3)
    found: dict[str, list[np.ndarray]] = {"weighted": [], "maximum-likelihood": []}
    stated, misfit = [], []
    for error in circular(np.random.default_rng(12), noise, tries(60, nightly=300)):
        for method, answers in found.items():
            fit = identify_elasticity(noisy(base, noise, error), SERIAL, method=method)
            answers.append(answer(fit))
        stated.append(np.diag(fit.covariance) / max(1.0, fit.misfit))
        misfit.append(fit.misfit)
    linear, likely = (np.array(answers) for answers in found.values())

    def bias(answers: np.ndarray) -> np.ndarray:
        error = answers.std(axis=0) / np.sqrt(len(answers))
        return np.abs(answers.mean(axis=0) - truth(2)) / error

    assert bias(linear).max() > 7
    assert bias(likely).max() < 4.5
    ratio = likely.var(axis=0) / np.mean(stated, axis=0)
    assert np.all((ratio > 0.7) & (ratio < 1.35)), ratio
    assert np.mean(misfit) == pytest.approx(1.0, abs=0.08)


def test_the_misfit_counts_the_parameters() -> None:
    """Four of the sixteen real numbers of two frequencies go into K and D."""
    base = example(2, BAND_HZ[[1, 4]])
    noise = mild_noise(base)
    fits = [
        identify_elasticity(noisy(base, noise, error), SERIAL, method="maximum-likelihood")
        for error in circular(np.random.default_rng(4), noise, 60)
    ]
    for misfits in ([fit.misfit for fit in fits], [fit.fundamental[0] for fit in fits]):
        assert np.mean(misfits) == pytest.approx(1.0, abs=0.13)


@pytest.mark.parametrize(("standard_errors", "late"), [(3, False), (7, True)])
def test_a_lag_is_chosen_where_it_is_significant(standard_errors: int, late: bool) -> None:
    """Five standard errors are the limit; so short a one may also be that of a filter."""
    base = example()
    noise = mild_noise(base)
    known = identify_elasticity(
        noisy(base, noise, 0 * base.z), SERIAL, method="maximum-likelihood", delay=True
    )
    tau = base.tau * np.exp(1j * base.omega[:, None] * standard_errors * known.delay_error)
    lagging = exact_phasors(base.omega / (2 * np.pi), base.q, tau)
    for error in circular(np.random.default_rng(9), noise, tries(3, long=6)):
        fit = identify_elasticity(noisy(lagging, noise, error), SERIAL)
        chosen = next(each.name for each in fit.candidates if each.chosen)
        assert (chosen != "elasticity") == late


@pytest.mark.parametrize("n", [1, 2, 3])
def test_without_noise_maximum_likelihood_is_exact(n: int) -> None:
    fit = identify_elasticity(example(n), ROBOTS[n][0], method="maximum-likelihood")
    assert np.allclose(answer(fit), truth(n), rtol=1e-8)


@pytest.fixture(scope="module")
def drawn() -> dict[str, list[ElasticityFit]]:
    """Fits of 300 realisations, 80 in a normal run, of the noise by each method."""
    base = example()
    noise = mild_noise(base)
    found: dict[str, list[ElasticityFit]] = {method: [] for method in LINEAR}
    for error in circular(np.random.default_rng(8), noise, tries(80, long=300)):
        data = noisy(base, noise, error)
        for method, of_method in found.items():
            of_method.append(identify_elasticity(data, SERIAL, method=method))
    return found


def test_stated_correlations_are_those_of_the_estimates(drawn: dict[str, list[ElasticityFit]]) -> None:
    fits = drawn["weighted"]
    seen = np.corrcoef(np.array([answer(fit) for fit in fits]).T)
    assert np.allclose(seen, np.mean([fit.correlation for fit in fits], axis=0), atol=0.15)
    assert np.allclose(np.diag(fits[0].correlation), 1)


def test_weighted_is_the_most_accurate_of_the_linear_ones(drawn: dict[str, list[ElasticityFit]]) -> None:
    spread = {m: np.std([answer(fit) for fit in fits], axis=0) for m, fits in drawn.items()}
    assert np.all(spread["weighted"] < 1.03 * spread["least-squares"])
    assert np.all(spread["weighted"] < 1.03 * spread["explicit"])
    assert np.any(spread["weighted"] < 0.7 * spread["least-squares"])


@pytest.mark.parametrize("method", LINEAR)
def test_residual_has_the_size_of_the_noise(method: str, drawn: dict[str, list[ElasticityFit]]) -> None:
    """Four of 28 real degrees of freedom per joint pair go into the fit."""
    ratio = [np.mean(np.abs(fit.residual) ** 2 / fit.residual_noise**2) for fit in drawn[method]]
    fit = drawn[method][0]
    assert fit.residual.shape == fit.residual_noise.shape == example().q.shape
    assert 0.85 < np.mean(ratio) < 1.2


def test_residual_is_an_unmodelled_torque() -> None:
    """A torque on joint 1 that the model does not contain is its residual."""
    base = example()
    fit = identify_elasticity(base, SERIAL, method="least-squares")
    equations = spring_equations(
        exact_phasors(base.omega / (2 * np.pi), base.q, base.tau + np.array([0.01, 0.0])), SERIAL
    )
    e = equations.residual(fit.K, fit.D) / -(base.omega[:, None] ** 2)
    spring = fit.K + 1j * base.omega[:, None] * fit.D
    inverse = np.linalg.inv(SERIAL.M2)
    expected = 0.01 * (np.array([1.0, 0.0]) - spring * inverse[:, 0] / base.omega[:, None] ** 2)
    assert np.allclose(e, expected, rtol=1e-6, atol=1e-12)


def test_wrong_inertia_shows_as_misfit_and_wide_errors() -> None:
    base = example()
    noise = mild_noise(base)
    data = noisy(base, noise, circular(np.random.default_rng(2), noise, 1)[0])
    right = identify_elasticity(data, SERIAL, method="weighted")
    wrong = identify_elasticity(data, Inertia(M=SERIAL.M, M2=1.05 * SERIAL.M2), method="weighted")
    assert right.misfit < 1.7
    assert wrong.misfit > 10
    assert np.all(wrong.standard_error > 2 * right.standard_error)


# Invariance


@pytest.mark.parametrize("method", LINEAR)
def test_answer_does_not_depend_on_names_signs_or_units(method: str) -> None:
    base = scattered()
    fit = identify_elasticity(base, SERIAL, method=method)
    order, turn = [1, 0], np.array([1e3, -1e-3])  # θ' = turn θ, τ' = τ / turn, a million apart
    both = np.concatenate([turn, 1 / turn])
    place = order + [2 + j for j in order]
    covariance = (base.covariance * np.outer(both, both))[:, place][:, :, place]
    changed = exact_phasors(
        base.omega / (2 * np.pi), (base.q * turn)[:, order], (base.tau / turn)[:, order], covariance
    )
    inertia = Inertia(
        M=(SERIAL.M / turn**2)[order], M2=(SERIAL.M2 / np.outer(turn, turn))[order][:, order]
    )
    same = identify_elasticity(changed, inertia, method=method)
    unit = np.tile(turn[order] ** 2, 2)
    assert np.allclose(answer(same) * unit, answer(fit)[place], rtol=1e-6)
    assert np.allclose(same.standard_error * unit, fit.standard_error[place], rtol=1e-6)
    assert same.misfit == pytest.approx(fit.misfit, rel=1e-6)


@pytest.mark.parametrize("method", LINEAR)
def test_answer_does_not_depend_on_amplitude_clock_or_order(method: str) -> None:
    base = scattered()
    fit = identify_elasticity(base, SERIAL, method=method)
    rng = np.random.default_rng(4)
    turn = 7.0 * np.exp(1j * rng.uniform(0, 6, base.omega.size))[:, None]
    mixed = exact_phasors(
        base.omega / (2 * np.pi), base.q * turn, base.tau * turn, base.covariance * 49.0
    ).select(rng.permutation(base.omega.size))
    again = identify_elasticity(mixed, SERIAL, method=method)
    assert np.allclose(answer(again), answer(fit), rtol=1e-9)
    assert np.allclose(again.standard_error, fit.standard_error, rtol=1e-9)


# What cannot be done, or should not be believed


def test_condition_of_a_poor_campaign_is_larger() -> None:
    """At 1 Hz damping is a thousandth of the elastic torque; over the band a tenth."""
    good = identify_elasticity(example(), SERIAL).condition
    poor = identify_elasticity(example(2, np.array([0.5, 0.6])), SERIAL).condition
    assert good >= 1
    assert poor > 3 * good


def test_joint_that_does_not_move_is_named() -> None:
    apart = Inertia(M=SERIAL.M, M2=np.diag([0.006, 0.002]))
    phasors = plant_phasors(apart, PAPER, *campaign(BAND_HZ, 2))
    still = exact_phasors(BAND_HZ.repeat(2), phasors.q * [1, 0], phasors.tau * [1, 0])
    for method in LINEAR:
        with pytest.raises(JointIdError, match=r"Joint 2 .*theta_m2_rad.*tau_m2_Nm"):
            identify_elasticity(still, apart, method=method)


def test_joints_whose_columns_are_empty_are_named() -> None:
    time = np.arange(4000) / 1000.0
    moving = np.zeros((4000, 3))
    moving[:, 0] = np.sin(2 * np.pi * 5 * time)
    for tau in (moving, 0 * moving):
        phasors = extract_phasors([SineRecord(5.0, time, moving, tau)])
        with pytest.raises(JointIdError, match=r"[Jj]oint 2"):
            identify_elasticity(phasors, THREE)


def test_joint_below_the_noise_is_refused_or_has_a_large_error() -> None:
    """Noise as large as the deflection of joint 2 biases a linear fit: its error must include that."""
    apart = Inertia(M=SERIAL.M, M2=np.diag([0.006, 0.002]))
    base = plant_phasors(apart, PAPER, *campaign([3.1, 4.3, 5.5], 2))
    deflection = np.abs(spring_equations(base, apart).deflection[:, 1])
    scale = np.array([1e-6, deflection.mean(), 1e-6, 1e-6])
    noise = np.array([np.diag(scale**2).astype(complex)] * 6)
    confident_and_wrong = 0
    for error in circular(np.random.default_rng(3), noise, 100):
        try:
            fit = identify_elasticity(noisy(base, noise, error), apart)
        except JointIdError:
            continue
        confident_and_wrong += bool(abs(fit.K[1] - 7.5) > 4 * fit.standard_error[1])
    assert confident_and_wrong <= 5


def active_phasors(K: list[float], D: list[float]) -> Phasors:
    """Equation (16) for springs and dampers that no arm has, which ``Elasticity`` refuses."""
    frequencies, torques = campaign(BAND_HZ, 2)
    s = 2j * np.pi * frequencies
    q = []
    for each, torque in zip(s, torques, strict=True):
        compliance = np.linalg.inv(SERIAL.M2) + np.diag(each**2 / (np.array(K) + each * np.array(D)))
        H = np.linalg.inv(np.linalg.inv(compliance) + np.diag(SERIAL.M))
        q.append(H @ torque / each**2)
    return exact_phasors(frequencies, np.array(q), torques)


@pytest.mark.parametrize("method", LINEAR)
def test_negative_stiffness_is_shown_but_not_usable(method: str) -> None:
    fit = identify_elasticity(active_phasors([43.0, -7.5], [0.1, 0.015]), SERIAL, method=method)
    assert np.allclose(fit.K, [43.0, -7.5], rtol=1e-9)
    with pytest.raises(JointIdError, match=r"K2 is −7.5 N·m/rad.*sign and unit.*joint 2"):
        _ = fit.elasticity


@pytest.mark.parametrize("method", LINEAR)
def test_negative_damping_is_shown_but_not_usable(method: str) -> None:
    fit = identify_elasticity(active_phasors([43.0, 7.5], [-0.1, 0.015]), SERIAL, method=method)
    assert np.allclose(fit.D, [-0.1, 0.015], rtol=1e-8)
    with pytest.raises(JointIdError, match=r"D1 is −0.1 N·m·s/rad.*torque_hold"):
        _ = fit.elasticity


def test_damping_negative_by_noise_counts_as_zero() -> None:
    stiff = Elasticity(K=PAPER.K, D=[0.0, 0.0])
    base = plant_phasors(SERIAL, stiff, *campaign(BAND_HZ, 2))
    noise = mild_noise(base)
    negative = 0
    for error in circular(np.random.default_rng(1), noise, 30):
        fit = identify_elasticity(noisy(base, noise, error), SERIAL, method="weighted")
        if fit.D.min() < 0 and np.all(fit.D + 2 * fit.standard_error[2:] > 0):
            negative += 1
            assert fit.elasticity.D.min() == 0.0
    assert negative > 10


def test_wrong_arguments_are_refused() -> None:
    base = example()
    with pytest.raises(JointIdError, match=r'method = "magic" is not known. Methods: .*least-squares'):
        identify_elasticity(base, SERIAL, method="magic")
    with pytest.raises(JointIdError, match="3 inertias for 14 records"):
        identify_elasticity(base, [SERIAL] * 3)
    with pytest.raises(JointIdError, match=r"2 joint.*inertia has 3"):
        identify_elasticity(base, THREE)


@pytest.mark.parametrize("method", LINEAR)
def test_two_hundred_records_and_one_accurate_record_among_inaccurate_ones(method: str) -> None:
    """Signal-to-noise from 1e10 down to 10 in one campaign."""
    base = example(2, np.linspace(3, 30, 100))
    level = np.full(200, 0.1)
    level[::20] = level[1::20] = 1e-10  # both records of a frequency
    amplitude = np.abs(base.z)
    noise = np.array([np.diag(s**2).astype(complex) for s in level[:, None] * amplitude])
    data = noisy(base, noise, circular(np.random.default_rng(1), noise, 1)[0])
    fit = identify_elasticity(data, SERIAL, method=method)
    assert np.all(np.abs(answer(fit) - truth(2)) < 5 * fit.standard_error)
    if method == "weighted":
        assert np.allclose(answer(fit), truth(2), rtol=1e-6)


# The whole error


@pytest.mark.parametrize("rests", [False, True])
@pytest.mark.parametrize("moves", [[False, False, False], [True, True, True], [False, True, True]])
def test_errors_hold_what_harmonics_and_rests_do_not_show(
    monkeypatch: pytest.MonkeyPatch, moves: list[bool], rests: bool
) -> None:
    """In proportion to the friction over the median torque of the records in which a joint slides."""
    base = identify_elasticity(example(), SERIAL, method="least-squares")
    monkeypatch.setattr(elasticity_module, "made_fit", lambda *_: replace(base, covariance=np.eye(4)))
    layout = ParameterLayout.of(2, friction=True, delay=True, effects=["motor_presliding", "load"])
    given = {"K": base.K, "D": base.D, "coulomb": [0.3, -0.1], "viscous": [0.02, 0.03], "delay": 1e-3}
    p = layout.named(layout.pack(**given, motor_presliding=[0.1, 0.0], load=[0.05, 0.06]))
    root = np.random.default_rng(3).standard_normal((layout.size, layout.size))
    C, torque = root @ root.T, np.array([[1.0, 0.1], [2.0, 0.9], [0.3, 0.5]])
    estimate: Any = SimpleNamespace(
        layout=layout, named=p, covariance=C, inertias=(SERIAL,) * 3, fundamental=(1.2, 30),
        prior_covariance=0.1 * C, rests_in_noise=rests, odd_misfit=1.0, gravity=None,
        friction_change=np.zeros(2),
        phasors=SimpleNamespace(torque_size=torque, motion=np.array(moves)),
    )  # fmt: skip
    choice: Any = SimpleNamespace(candidates=("a", "b"), spread=np.diag([4.0, 1.0, 9.0, 0.25]))
    fit = likelihood_fit("auto", choice, estimate, base.equations, base.prior, base.torsion_curves)
    share = 4 / np.pi * np.array([0.3 / 1.5, 0.1 / 0.7])  # the third and first records rest
    of_sines, of_motions = (not all(moves)) * share, (any(moves) and not rests) * share**2
    floor = np.r_[5e-4 * of_sines + 3e-3 * of_motions, 1.5e-3 * of_sines + 6e-3 * of_motions]
    floor *= np.abs(base.estimate)
    np.testing.assert_allclose(fit.unseen_error, floor)
    np.testing.assert_allclose(fit.covariance, np.eye(4) + choice.spread + np.diag(floor**2))
    np.testing.assert_allclose(fit.choice_error, [2.0, 1.0, 3.0, 0.5])
    np.testing.assert_allclose(fit.prior_error, np.sqrt(0.1 * np.diag(C)[:4]))
    np.testing.assert_allclose(fit.noise_error, np.sqrt(np.maximum(1 - 0.1 * np.diag(C)[:4], 0)))
    late = layout["delay"].start
    assert (fit.delay, fit.delay_error) == (1e-3, pytest.approx(np.sqrt(C[late, late])))
    assert fit.friction is not None
    np.testing.assert_allclose(fit.friction.coulomb, [0.4, -0.1])  # after a long move
    own, rising = (np.arange(layout.size)[layout[x]] for x in ("coulomb", "motor_presliding"))
    both = np.diag(C)[own] + np.diag(C)[rising] + 2 * C[own, rising]
    np.testing.assert_allclose(fit.friction.standard_error[:2], np.sqrt(both))
    viscous = np.arange(layout.size)[layout["viscous"]]
    np.testing.assert_allclose(fit.friction.standard_error[2:], np.sqrt(np.diag(C)[viscous]))
    assert list(np.atleast_1d(fit.friction.load)) == [0.05, 0.06]


def test_correlations_and_condition_are_in_units_of_the_errors() -> None:
    fit = identify_elasticity(example(), SERIAL, method="least-squares")
    A = fit.equations.matrix()[0] * np.array([fit.D[0], fit.K[0], fit.D[1], fit.K[1]])
    assert fit.condition == pytest.approx(np.linalg.cond(A))
    wide = np.array([[4.0, 1, 0, 0], [1, 9, 0, 0], [0, 0, np.inf, 0], [0, 0, 0, 25.0]])
    other = replace(fit, covariance=wide, D=np.array([1e-9, 1e-9]))
    A = fit.equations.matrix()[0] * np.array([1e-9, fit.K[0], 5.0, fit.K[1]])
    assert other.condition == pytest.approx(np.linalg.cond(A))  # damping counts at least by its error
    expected = np.eye(4)
    expected[0, 1] = expected[1, 0] = 1 / 6
    np.testing.assert_allclose(other.correlation, expected)
    assert np.isinf(other.relative_error[2])
    lost = replace(fit, covariance=np.diag(np.r_[(fit.K / [1.9, 2.1]) ** 2, 1, 1]))
    assert undetermined(lost).tolist() == [True, False]
