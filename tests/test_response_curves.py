"""Response curves of app and report: error bars, branches, shared scales."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some
from plants import PAPER, PARALLELOGRAM

from jointid import Analysis, Study, analyse, motor_response
from jointid.figures import element_response
from jointid.figures.response_curves import (
    Response,
    band_of,
    element_curves,
    magnitude_limits,
    measured,
    model_curves,
    phase_deg,
    single_record_curves,
)

BAND_HZ = np.geomspace(3.0, 30.0, 300)


@pytest.fixture(scope="module")
def analysis(studies: dict[int, Study]) -> Analysis:
    return analyse(studies[2], method="weighted")


@given(some.integers(0, 2**32 - 1), some.floats(0.0, 0.4), some.integers(0, 1))
def test_noisy_points_stay_on_the_branch_of_the_model(seed: int, noise: float, joint: int) -> None:
    H = motor_response(2 * np.pi * BAND_HZ, PARALLELOGRAM, PAPER)[:, joint, joint]
    model = Response(BAND_HZ, H)
    rng = np.random.default_rng(seed)
    keep = np.sort(rng.choice(BAND_HZ.size, 20, replace=False))
    turn = rng.uniform(-noise, noise, keep.size)
    points = Response(BAND_HZ[keep], H[keep] * np.exp(1j * turn))
    line = phase_deg(model, model)
    assert np.abs(np.diff(line)).max() < 90  # a steep peak, never a jump of 360°
    assert phase_deg(points, model) - line[keep] == pytest.approx(np.degrees(turn), abs=1e-6)
    assert np.exp(1j * np.radians(line)) == pytest.approx(H / np.abs(H))


def test_without_a_model_the_phase_lies_about_90_degrees() -> None:
    phase = phase_deg(Response(np.array([1.0, 2.0]), np.array([-1.0 - 1e-9j, 1.0 - 1e-9j])), None)
    assert phase == pytest.approx([180, 0], abs=1e-3)


def test_errors_are_those_along_the_phasor(analysis: Analysis) -> None:
    matrix = analysis.transfer_matrices[""]
    points = measured(matrix, 1, 0)
    assert points.H.tolist() == matrix.H[:, 1, 0].tolist()
    assert points.error is not None
    assert points.relative_error is not None
    # The complex variance lies half along the phasor and half across it.
    assert 2 * points.error**2 == pytest.approx(matrix.standard_deviation[:, 1, 0] ** 2)
    assert points.relative_error == pytest.approx(points.error / np.abs(points.H))


def test_the_models_are_those_of_the_study_over_its_band(analysis: Analysis) -> None:
    inertia, study = analysis.study.inertia, analysis.study
    assert study.nominal is not None
    low, high = band_of(np.array([r.frequency_hz for r in study.records]))
    models = model_curves(analysis, "", 0, 1)
    for model, elasticity in zip(models, (study.nominal, analysis.fit.elasticity), strict=True):
        found = model.response
        f = found.frequency_hz
        assert np.all(np.diff(f) > 0)
        assert (f[0], f[-1]) == pytest.approx((low, high))
        assert pytest.approx(motor_response(2 * np.pi * f, inertia, elasticity)[:, 0, 1]) == found.H


def test_a_narrow_band_is_widened() -> None:
    assert band_of(np.array([3.0, 30.0])) == pytest.approx((3 / 1.12, 30 * 1.12))
    assert band_of(np.array([8.0])) == (4.0, 16.0)


def test_the_report_and_the_app_draw_the_same_points_on_one_scale(analysis: Analysis) -> None:
    low, high = magnitude_limits(analysis, "", 0)
    *_, points = element_curves(analysis, "", 0, 0)
    drawn = [t for t in element_response(analysis, 0, 0).data if t.mode == "markers" and t.yaxis != "y2"]
    assert drawn[-1].y == pytest.approx(np.abs(points.response.H))
    assert np.all((np.abs(points.response.H) >= low) & (np.abs(points.response.H) <= high))
    alone = [c.response for c in single_record_curves(analysis, "", 0) if c.symbol]
    assert sum(each.H.size for each in alone) == len(analysis.study.records)
