"""The tool path: smooth derivatives, limits, and dimensions of the rectangle."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_cases import examples

from jointid.cut.rectangle import rectangle
from jointid.cut.toolpath import Toolpath
from jointid.errors import JointIdError

ZONES = (0.0, 0.001, 0.005, 0.010, 0.014)


def top_speed(path: Toolpath) -> float:
    return float(np.linalg.norm(path.velocity_m_s, axis=1).max())


@pytest.mark.parametrize("zone", ZONES)
def test_each_derivative_is_the_slope_of_the_one_before(zone) -> None:
    path, h = rectangle(zone_m=zone), 1e-5
    time = np.linspace(0.001, path.end_s - 0.001, 2000)
    now, before, after = (path.derivatives(time + shift) for shift in (0, -h, h))
    for lower, upper in pairwise(range(5)):
        slope = (after[lower] - before[lower]) / (2 * h)
        scale = np.abs(now[upper]).max()
        np.testing.assert_allclose(slope, now[upper], atol=1e-4 * scale)


@pytest.mark.parametrize("zone", ZONES)
def test_position_to_snap_are_continuous(zone) -> None:
    path, h = rectangle(zone_m=zone, repetitions=2), 1e-9
    before, after = (path.derivatives(path.time_s[1:-1] + shift) for shift in (-h, h))
    everywhere = np.abs(path.derivatives(np.linspace(0, path.end_s, 5000))).max(axis=(1, 2))
    jump = np.abs(after - before).max(axis=(1, 2))
    assert np.all(jump < 1e-4 * everywhere)


@examples(200, derandomize=True)
@given(
    zone=st.floats(0.0, 0.014),
    speed=st.floats(0.05, 0.30),
    size=st.floats(1.0, 3.0),
    acceleration=st.floats(15.0, 30.0),
)
def test_limits_are_kept(zone, speed, size, acceleration) -> None:
    path = rectangle(
        zone_m=zone,
        width_m=0.028 * size,
        height_m=0.045 * size,
        speed_m_s=speed,
        acceleration_m_s2=acceleration,
    )
    assert 0.9 * speed <= top_speed(path) <= speed * (1 + 1e-12)
    assert path.peak_acceleration_m_s2 <= acceleration * (1 + 1e-12)
    changes = np.abs(np.diff(path.velocity_m_s, axis=0)).max(axis=1) > 1e-9
    assert path.duration_s[changes].min() >= 0.05 - 1e-12
    sampled = path.derivatives(np.linspace(0, path.end_s, 3000))
    assert np.linalg.norm(sampled[1], axis=1).max() <= top_speed(path) * (1 + 1e-9)
    assert np.linalg.norm(sampled[2], axis=1).max() <= path.peak_acceleration_m_s2 * (1 + 1e-9)


@examples(100, derandomize=True)
@given(zone=st.floats(0.0, 0.014), rounds=st.integers(1, 3), flat=st.booleans())
def test_the_rectangle_has_the_specified_size(zone, rounds, flat) -> None:
    width, height = (0.045, 0.028) if flat else (0.028, 0.045)
    path = rectangle(
        zone_m=zone, width_m=width, height_m=height, repetitions=rounds, centre_m=(1.0, 0.2)
    )
    # The lead-in may reach beyond a short side; the sides' lines it never leaves.
    across = 1 if flat else 0
    points = path.position(np.linspace(0, path.end_s, 20_000)) - [1.0, 0.2]
    size = (width, height)[across]
    assert np.ptp(points[:, across]) == pytest.approx(size, abs=1e-9)
    assert points[:, across].max() == pytest.approx(size / 2, abs=1e-9)
    ends = path.position([0.0, path.end_s]) - [1.0, 0.2]
    assert ends.sum(axis=0) == pytest.approx(
        [2 * ends[0, 0], 0] if not flat else [0, 2 * ends[0, 1]], abs=1e-9
    )
    # One corner zone at each of the four corner points, in every round.
    before, after = path.velocity_m_s[:-1], path.velocity_m_s[1:]
    turns = np.flatnonzero(np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]) > 1e-9)
    if zone > 1e-6:
        assert len(turns) == 4 * rounds
        middle = path.position(path.time_s[turns] + path.duration_s[turns] / 2) - [1.0, 0.2]
        np.testing.assert_allclose(np.abs(middle).max(axis=0), np.array([width, height]) / 2, atol=zone)
        assert len(np.unique(np.sign(middle), axis=0)) == 4


def test_a_corner_zone_begins_and_ends_at_its_distance() -> None:
    """Deviation from the sharp rectangle starts exactly one zone before the corner."""
    zone = 0.010
    path = rectangle(zone_m=zone, centre_m=(0.0, 0.0))
    points = path.position(np.linspace(0, path.end_s, 100_000))
    near = points[(points[:, 0] > 0) & (points[:, 1] > 0)]  # the upper right corner
    on_side = near[np.abs(near[:, 0] - 0.014) < 1e-12]
    assert on_side[:, 1].max() == pytest.approx(0.0225 - zone, abs=2e-4)
    # Half-way, each axis has moved z − 2z ∫₀^½ S towards the corner: the rest is missing.
    antiderivative = np.polynomial.Polynomial([0, 0, 0, 0, 35, -84, 70, -20]).integ()
    inset = zone * 2 * antiderivative(0.5)
    corner_gap = np.abs(near - [0.014, 0.0225]).sum(axis=1).min()
    assert corner_gap == pytest.approx(2 * inset, abs=1e-7)


def test_the_paper_cut_runs_at_full_speed_in_the_largest_zone() -> None:
    path = rectangle(zone_m=0.010)
    assert top_speed(path) == pytest.approx(0.3)
    moving = slice(1, -2)
    np.testing.assert_allclose(np.linalg.norm(path.velocity_m_s[moving], axis=1), 0.3)
    # 0.3² / 0.02 · 35/16 · √2, below the limit of 15 m/s².
    assert path.peak_acceleration_m_s2 == pytest.approx(13.92, abs=0.01)


def test_a_path_is_rotated_and_shifted() -> None:
    plain = rectangle(centre_m=(0.0, 0.0))
    turned = rectangle(centre_m=(0.9, -0.3), angle_rad=0.7)
    time = np.linspace(0, plain.end_s, 500)
    R = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    np.testing.assert_allclose(
        turned.position(time), plain.position(time) @ R.T + [0.9, -0.3], atol=1e-12
    )


def test_rest_before_and_after() -> None:
    path = rectangle(settle_s=0.2)
    np.testing.assert_array_equal(path.derivatives([-1.0])[:, 0], path.derivatives([0.0])[:, 0])
    late = path.derivatives([path.end_s - 0.19, path.end_s + 5.0])
    np.testing.assert_array_equal(late[1:], 0.0)
    np.testing.assert_allclose(late[0, 0], late[0, 1], atol=1e-12)


@pytest.mark.parametrize("zone", ZONES)
def test_distance_to_the_path(zone) -> None:
    path = rectangle(zone_m=zone, centre_m=(0.0, 0.0), repetitions=2)
    on_path = path.position(np.linspace(0, path.end_s, 7001))
    assert path.distance(on_path).max() < 1.5e-7
    assert path.distance([[0.015, 0.0], [0.0, 0.0255]]) == pytest.approx([0.001, 0.003], abs=1e-9)
    if zone < 0.01:
        assert path.distance([0.0, 0.0]) == pytest.approx(0.014, abs=1e-9)


@examples(50, derandomize=True)
@given(x=st.floats(-0.03, 0.03), y=st.floats(-0.04, 0.04), zone=st.sampled_from([0.001, 0.01]))
def test_distance_agrees_with_brute_force(x, y, zone) -> None:
    path = rectangle(zone_m=zone, centre_m=(0.0, 0.0))
    points = path.position(np.linspace(0, path.end_s, 40_000))
    brute = np.hypot(*(points - [x, y]).T).min()
    # Brute force stands at most half a spacing (4 µm) aside of the nearest point.
    assert path.distance([x, y]) <= brute + 1.5e-7
    assert path.distance([x, y]) == pytest.approx(np.sqrt(max(brute**2 - 4e-6**2, 0)), abs=4.5e-6)


@pytest.mark.parametrize(
    ("settings_", "message"),
    [
        ({"zone_m": 0.0141}, r"zone of 14.1 mm .* shorter side of 28 mm. Use a zone of at most 14 mm"),
        ({"zone_m": -0.001}, "zone_m = -0.001 m: it must not be negative"),
        ({"speed_m_s": 0.0}, "speed_m_s = 0 m/s: it must be positive"),
        ({"speed_m_s": 2.0}, r"A speed of 2000 mm/s is not reached.*Lower the speed to 31\d"),
        ({"width_m": float("nan")}, "width_m"),
        ({"repetitions": 0}, "repetitions = 0"),
        ({"repetitions": 1.5}, "repetitions = 1.5"),
        ({"centre_m": (1.0,)}, "centre_m"),
        ({"centre_m": "here"}, "centre_m"),
        ({"angle_rad": float("inf")}, "angle_rad"),
        ({"acceleration_m_s2": -1.0}, "acceleration_m_s2 = -1"),
    ],
)
def test_infeasible_rectangles_name_a_feasible_speed(settings_, message) -> None:
    with pytest.raises(JointIdError, match=message):
        rectangle(**settings_)


def test_the_speed_that_the_message_names_is_feasible() -> None:
    with pytest.raises(JointIdError) as refused:
        rectangle(speed_m_s=0.8, zone_m=0.004)
    named = float(str(refused.value).split("Lower the speed to ")[1].split(" mm/s")[0]) / 1e3
    assert top_speed(rectangle(speed_m_s=named, zone_m=0.004)) == pytest.approx(named, rel=1e-9)


def test_a_user_defined_path_is_tracked() -> None:
    path = Toolpath(start_m=[1.0, 0.0], velocity_m_s=[[0, 0], [0.1, 0], [0, 0]], duration_s=[0.2, 0.2])
    np.testing.assert_allclose(path.position([path.end_s]), [[1.02, 0.0]])
    with pytest.raises(JointIdError, match="rest to rest"):
        Toolpath(start_m=[1.0, 0.0], velocity_m_s=[[0, 0], [0.1, 0]], duration_s=[0.2])
    with pytest.raises(JointIdError, match="piece 2 is 0 s"):
        Toolpath(start_m=[1.0, 0.0], velocity_m_s=[[0, 0], [0.1, 0], [0, 0]], duration_s=[0.2, 0.0])
    with pytest.raises(JointIdError, match="expected"):
        Toolpath(start_m=[1.0, 0.0], velocity_m_s=[[0, 0]], duration_s=[0.2])
