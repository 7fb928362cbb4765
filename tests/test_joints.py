"""The model, equations (1), (5)-(7) and (16), against eigenvalues and responses of its state space."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plants import PAPER, PARALLELOGRAM, ROBOTS, SERIAL, state_space
from random_cases import examples

from jointid import (
    Elasticity,
    Inertia,
    JointIdError,
    diagonal_zeros,
    locked_motor_response,
    locked_resonances,
    motor_response,
    resonances,
)

OMEGA = 2 * np.pi * np.array([0.3, 3.0, 9.97, 16.0, 26.6, 80.0])


@st.composite
def robots(draw: st.DrawFn) -> tuple[Inertia, Elasticity]:
    """Any robot of one to four joints, its joints up to a million times apart in scale."""
    n = draw(st.integers(1, 4))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    gear = 10 ** rng.uniform(-1.5, 1.5, n)
    root = rng.standard_normal((n, n)) + 2 * np.eye(n)
    arm = 0.003 * (root @ root.T + 0.1 * np.eye(n)) * np.outer(gear, gear)
    inertia = Inertia(M=0.002 * rng.uniform(0.2, 3, n) * gear**2, M2=arm)
    K = rng.uniform(5, 80, n) * gear**2
    return inertia, Elasticity(K=K, D=K * 10 ** rng.uniform(-4, -2, n))


def relative(H: np.ndarray, inertia: Inertia) -> np.ndarray:
    """H in units that do not depend on the scale of a joint."""
    unit = np.sqrt(inertia.M)
    return H * np.outer(unit, unit)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_response_equals_that_of_the_state_space(n: int) -> None:
    inertia, elasticity = ROBOTS[n]
    A, B = state_space(inertia, elasticity)
    expected = [1j * w * np.linalg.solve(1j * w * np.eye(4 * n) - A, B)[2 * n : 3 * n] for w in OMEGA]
    assert np.allclose(motor_response(OMEGA, inertia, elasticity), expected, rtol=1e-9)


def test_arm_with_locked_motors_equals_its_state_space() -> None:
    A, _ = state_space(SERIAL, PAPER)
    arm = [2, 3, 6, 7]  # angles and rates of the arm alone
    force = np.vstack([np.zeros((2, 2)), np.linalg.inv(SERIAL.M2)])
    expected = [
        1j * w * np.linalg.solve(1j * w * np.eye(4) - A[np.ix_(arm, arm)], force)[2:] for w in OMEGA
    ]
    assert np.allclose(locked_motor_response(OMEGA, SERIAL, PAPER), expected, rtol=1e-9)
    assert not locked_motor_response([0.0], SERIAL, PAPER).any()


@examples(60)
@given(robots())
def test_limits_of_the_response(robot: tuple[Inertia, Elasticity]) -> None:
    """At low frequency all bodies move together; at high frequency the motors move alone."""
    inertia, elasticity = robot
    slow, fast = motor_response([0.0, 1e9], inertia, elasticity)
    together = np.linalg.inv(np.diag(inertia.M) + inertia.M2)
    assert np.allclose(relative(slow, inertia), relative(together, inertia), rtol=1e-8, atol=1e-10)
    assert np.allclose(relative(fast, inertia), np.eye(inertia.n), atol=1e-4)


@examples(60)
@given(robots(), st.floats(0.1, 1000))
def test_response_is_reciprocal_and_dissipates(robot: tuple[Inertia, Elasticity], omega: float) -> None:
    inertia, elasticity = robot
    H = relative(motor_response([omega], inertia, elasticity)[0], inertia)
    assert np.allclose(H, H.T, rtol=1e-7, atol=1e-9 * np.abs(H).max())
    # Velocity over torque is H / iω: its Hermitian part is power taken in, which is never negative.
    mobility = H / 1j
    taken = np.linalg.eigvalsh(mobility + mobility.conj().T)
    assert taken.min() > -1e-7 * np.abs(H).max()


@examples(30)
@given(robots(), st.integers(0, 2**32 - 1))
def test_response_does_not_depend_on_names_signs_or_units(
    robot: tuple[Inertia, Elasticity], seed: int
) -> None:
    inertia, elasticity = robot
    rng = np.random.default_rng(seed)
    order, sign = rng.permutation(inertia.n), rng.choice([-1.0, 1.0], inertia.n)
    gear = 10 ** rng.uniform(-3, 3, inertia.n)
    H = motor_response(OMEGA, inertia, elasticity)

    turn = sign * gear  # θ' = turn θ, and so τ' = τ / turn
    changed = motor_response(
        OMEGA,
        Inertia(M=(inertia.M / gear**2)[order], M2=(inertia.M2 / np.outer(turn, turn))[order][:, order]),
        Elasticity(K=(elasticity.K / gear**2)[order], D=(elasticity.D / gear**2)[order]),
    )
    expected = (H * np.outer(turn, turn))[:, order][:, :, order]
    assert np.allclose(changed / expected, 1, rtol=1e-6)


@pytest.mark.parametrize(
    ("inertia", "locked", "free", "zeros"),
    [
        (PARALLELOGRAM, [9.97, 16.56], [17.07, 26.61], [[15.99, 17.54], [10.09, 26.60]]),
        (SERIAL, [8.79, 18.77], [17.58, 27.31], [[13.36, 21.00], [11.46, 27.09]]),
    ],
)
def test_frequencies_of_the_papers_arm(
    inertia: Inertia, locked: list[float], free: list[float], zeros: list[list[float]]
) -> None:
    """The table of the example arm's cutting pose, to the digits it is printed with."""
    assert np.allclose(locked_resonances(inertia, PAPER), locked, atol=0.011)
    assert np.allclose(resonances(inertia, PAPER), free, atol=0.011)
    assert np.allclose(diagonal_zeros(inertia, PAPER), zeros, atol=0.011)


@examples(40)
@given(robots())
def test_natural_frequencies_are_eigenvalues_of_the_state_space(
    robot: tuple[Inertia, Elasticity],
) -> None:
    inertia, elasticity = robot
    n = inertia.n
    A, _ = state_space(inertia, Elasticity(K=elasticity.K, D=np.zeros(n)))

    def frequencies(fixed: set[int], count: int) -> np.ndarray:
        kept = [i for i in range(2 * n) if i not in fixed]
        stiffness = -A[2 * n :, : 2 * n][np.ix_(kept, kept)]
        squared = np.sort(np.linalg.eigvals(stiffness).real)[-count:]
        return np.sqrt(squared) / (2 * np.pi)

    assert np.allclose(resonances(inertia, elasticity), frequencies(set(), n), rtol=1e-5)
    assert np.allclose(locked_resonances(inertia, elasticity), frequencies(set(range(n)), n), rtol=1e-5)
    zeros = [frequencies({j}, n) for j in range(n)]
    assert np.allclose(diagonal_zeros(inertia, elasticity), zeros, rtol=1e-5)


def test_resonances_are_poles_and_zeros_are_zeros() -> None:
    light = Elasticity(K=PAPER.K, D=PAPER.D * 1e-6)
    pole = 2 * np.pi * resonances(SERIAL, light)
    assert np.abs(motor_response(pole, SERIAL, light)).min(axis=(1, 2)).min() > 1e6
    for j, row in enumerate(2 * np.pi * diagonal_zeros(SERIAL, light)):
        assert np.abs(motor_response(row, SERIAL, light)[:, j, j]).max() < 1.0


def test_undamped_arm_at_its_resonance_is_infinite_not_an_error() -> None:
    inertia, elasticity = Inertia(M=[1.0], M2=[[1.0]]), Elasticity(K=[4.0], D=[0.0])
    assert np.abs(locked_motor_response([2.0], inertia, elasticity)[0, 0, 0]) > 1e12


def test_inertia_is_stored_symmetric() -> None:
    rounded = Inertia(M=[1.0, 1.0], M2=[[2.0, 0.5], [0.5000004, 2.0]])
    assert np.array_equal(rounded.M2, rounded.M2.T)


def test_values_are_copied_and_cannot_change() -> None:
    M = np.array([0.0025, 0.001])
    inertia = Inertia(M=M, M2=SERIAL.M2)
    M[0] = 7.0
    assert inertia.M[0] == 0.0025
    with pytest.raises(ValueError, match="read-only"):
        inertia.M2[0, 0] = 1.0


@pytest.mark.parametrize(
    ("M", "M2", "message"),
    [
        ([], [[]], "empty"),
        ([0.0025, -0.001], SERIAL.M2, r"M.*2 = -0.001 kg·m².*positive"),
        ([0.0025, 0.001], [[0.004]], r"shape \(1, 1\).*\(2, 2\)"),
        ([0.0025, 0.001], [[0.004, 0.001], [0.0005, 0.002]], r"J_12 = 0.001 .*J_21 = 0.0005"),
        ([0.0025, 0.001], [[0.004, 0.004], [0.004, 0.002]], "positive definite.*gear ratios"),
        ([0.0025, 0.001], [[0.004, 0.0], [0.0, -0.002]], "positive definite"),
        ([np.nan, 0.001], SERIAL.M2, r"M.*index 0 is nan"),
        ("heavy", SERIAL.M2, r"M.*: expected.*numbers, got 'heavy'"),
    ],
)
def test_wrong_inertia_is_named_with_its_element(M: object, M2: object, message: str) -> None:
    with pytest.raises(JointIdError, match=message):
        Inertia(M=M, M2=M2)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("K", "D", "message"),
    [
        ([43.0, 0.0], [0.1, 0.1], r"K2 = 0 N·m/rad.*positive"),
        ([43.0, 7.5], [0.1, -0.1], r"D2 = -0.1 N·m·s/rad.*negative"),
        ([43.0, 7.5], [0.1], "K has 2 value.*D has 1"),
        ([], [], "one of each per joint"),
        ([43.0, np.inf], [0.1, 0.1], "index 1 is inf"),
    ],
)
def test_wrong_elasticity_is_named_with_its_element(K: object, D: object, message: str) -> None:
    with pytest.raises(JointIdError, match=message):
        Elasticity(K=K, D=D)  # type: ignore[arg-type]


def test_model_of_different_joints_is_refused() -> None:
    with pytest.raises(JointIdError, match=r"inertia has 2 joint.*elasticity 1"):
        motor_response([1.0], SERIAL, Elasticity(K=[1.0], D=[0.0]))


WILD = st.one_of(
    st.none(),
    st.text(max_size=5),
    st.booleans(),
    st.complex_numbers(),
    st.integers(-(10**400), 10**400),
    st.floats(),
    st.lists(st.floats(), max_size=4),
    st.lists(st.lists(st.floats(), max_size=3), max_size=3),
    st.lists(st.one_of(st.none(), st.text(max_size=2), st.lists(st.integers())), max_size=4),
    st.sampled_from(
        [
            np.zeros((2, 2, 2)),
            np.array([object(), object()]),
            np.array([1 + 2j]),
            np.array(["a"]),
            np.array([[1, None]], dtype=object),
            np.array(["2020-01-01"], dtype="datetime64[s]"),
            np.array([[1e200, 0.0], [0.0, 1e200]]),
            np.array([1e-320]),
            {},
            {1.0, 2.0},
            object(),
        ]
    ),
)


@examples(300)
@given(WILD, WILD)
def test_arbitrary_input_raises_only_jointiderror(first: object, second: object) -> None:
    for what in (Inertia, Elasticity):
        try:
            value = what(first, second)  # type: ignore[arg-type]
        except JointIdError:
            continue
        assert all(np.isfinite(field).all() for field in vars(value).values())


@pytest.mark.parametrize(
    "value",
    [np.array([1 + 2j]), [1 + 2j], 10**400, [10**400], [[1], [2, 3]]],
    ids=["complex array", "complex list", "huge integer", "huge integers", "ragged"],
)
def test_input_that_numpy_would_convert_is_refused(value: object) -> None:
    with pytest.raises(JointIdError):
        Elasticity(K=value, D=[0.1])  # type: ignore[arg-type]
