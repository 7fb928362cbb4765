"""The paper's experiment on a simulated robot: the peaks of section 4.1, the K and D of section 4.2."""

from __future__ import annotations

import numpy as np
import pytest
from plants import PAPER, PARALLELOGRAM, SERIAL
from scipy.signal import find_peaks

from jointid import (
    Inertia,
    Study,
    analyse,
    estimate_transfer_matrix,
    extract_phasors,
    identify_elasticity,
    locked_resonances,
    motor_response,
    simulate_records,
    single_record_response,
)
from jointid.simulation.experiment import Controller, Excitation, Measurement, MotorFriction

BAND = np.array([3.1, 4.7, 6.3, 8.1, 10.3, 12.7, 15.1, 17.7, 20.3, 23.3, 26.7, 29.9])
SENSORS = Measurement(encoder_counts=65_536, position_noise_rad=5e-5, torque_noise_Nm=[0.02, 0.01])
METHODS = ["least-squares", "explicit", "weighted"]


@pytest.fixture(scope="module", params=[PARALLELOGRAM, SERIAL], ids=["parallelogram", "serial"])
def campaign(request: pytest.FixtureRequest) -> Study:
    """Closed loop, held torque, encoder, noise; two records of 1.5 s at each of twelve frequencies."""
    inertia: Inertia = request.param
    records = simulate_records(
        inertia, PAPER, BAND, excitation=Excitation(duration_s=1.5), measurement=SENSORS, seed=4
    )
    return Study(records, inertia)


@pytest.mark.parametrize("method", METHODS)
def test_parameters_of_section_4_2_are_recovered(campaign: Study, method: str) -> None:
    """K within 0.05 per cent, D within 0.3 per cent, and within what the error bars say."""
    fit = identify_elasticity(extract_phasors(campaign.records), campaign.inertia, method=method)
    assert np.allclose(fit.K, [43.0, 7.5], rtol=5e-4)
    assert np.allclose(fit.D, [0.10, 0.015], rtol=3e-3)
    deviation = np.concatenate([fit.K - PAPER.K, fit.D - PAPER.D]) / fit.standard_error
    assert np.all(np.abs(deviation) < 4.5)
    assert np.all(fit.standard_error[:2] < 1e-3 * fit.K)
    assert fit.misfit < 2.5


def test_parameters_are_recovered_under_friction() -> None:
    """Friction of 0.05 and 0.02 N·m biases least squares by a tenth; the default method stays exact."""
    records = simulate_records(
        PARALLELOGRAM,
        PAPER,
        BAND,
        excitation=Excitation(duration_s=1.5),
        measurement=SENSORS,
        friction=MotorFriction(coulomb=[0.05, 0.02], viscous=[0.002, 0.001], step_s=5e-4),
        seed=5,
    )
    analysis = analyse(Study(records, PARALLELOGRAM))
    plain = analysis.fits["least-squares"]
    assert np.abs(plain.D / PAPER.D - 1).max() > 0.05
    assert np.allclose(analysis.fit.K, PAPER.K, rtol=2e-3)
    assert np.allclose(analysis.fit.D, PAPER.D, rtol=0.01)


def test_ignoring_the_torque_hold_biases_damping_by_per_cents() -> None:
    """Ignoring it biases the damping by per cents at 4 kHz; stating it removes the bias."""
    error = {}
    for told in (True, False):
        records = simulate_records(
            PARALLELOGRAM, PAPER, BAND, excitation=Excitation(periods=8.4), declare_timing=told
        )
        fit = identify_elasticity(extract_phasors(records), PARALLELOGRAM, method="least-squares")
        error[told] = np.abs(np.concatenate([fit.K / PAPER.K, fit.D / PAPER.D]) - 1)
    assert error[True].max() < 2e-4
    assert error[False][2:].max() > 0.01


def peaks(curve: np.ndarray) -> list[int]:
    """Indices of maxima that stand at least a tenth above what surrounds them."""
    return [int(i) for i in find_peaks(np.log10(curve), prominence=np.log10(1.1))[0]]


def test_one_record_shows_two_peaks_and_the_transfer_matrix_one() -> None:
    """Figures 3 and 4: the first peak of Figure 3 belongs to the coupled joint's control loop."""
    frequencies = np.arange(4.0, 36.0, 0.8)

    def measured(neighbour: Controller) -> tuple[np.ndarray, np.ndarray]:
        records = simulate_records(
            PARALLELOGRAM,
            PAPER,
            frequencies,
            excitation=Excitation(periods=9.0),
            controller=neighbour,
        )
        phasors = extract_phasors(records, harmonics=1)
        alone = np.abs(single_record_response(phasors)[::2, 0])
        return alone, np.abs(estimate_transfer_matrix(phasors).H[:, 0, 0])

    alone, H11 = measured(Controller(bandwidth_hz=[5.0, 13.0], damping_ratio=[0.5, 0.1]))
    assert len(peaks(alone)) == 2
    assert len(peaks(H11)) == 1
    # The second peak is the joint's own; the first stands where the neighbour swings, far below.
    first, second = frequencies[peaks(alone)]
    (own,) = frequencies[peaks(H11)]
    assert second == pytest.approx(own, abs=1.7)
    assert first < 0.5 * own
    model = np.abs(motor_response(2 * np.pi * frequencies, PARALLELOGRAM, PAPER)[:, 0, 0])
    assert np.allclose(H11, model, rtol=2e-3)

    # A calmer neighbour takes the first peak away, and changes nothing in the transfer matrix.
    calm, again = measured(Controller(bandwidth_hz=5.0, damping_ratio=0.7))
    assert len(peaks(calm)) == 1
    assert np.allclose(again, H11, rtol=2e-3)
    assert np.abs(np.log10(alone / calm)).max() > np.log10(1.5)


def test_identification_from_one_record_in_closed_loop() -> None:
    """Section 3.2: "from only one sinoid measurement series", near the arm's own resonances."""
    for frequency in locked_resonances(PARALLELOGRAM, PAPER):
        records = simulate_records(
            PARALLELOGRAM, PAPER, [frequency], excitation=Excitation(periods=20.4), measurement=SENSORS
        )
        fit = identify_elasticity(extract_phasors(records[:1]), PARALLELOGRAM, method="least-squares")
        assert np.allclose(fit.K, PAPER.K, rtol=0.01)
        assert np.allclose(fit.D, PAPER.D, rtol=0.05)
