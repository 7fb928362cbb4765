"""Records without and with a known payload: they determine the torque scale."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from plants import PAPER, PARALLELOGRAM
from scipy.io import loadmat

from jointid import Controller, Excitation, Inertia, JointIdError, Measurement, Study, analyse
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.joint_equations import spring_equations
from jointid.estimation.estimators.levenberg_marquardt import quadratic
from jointid.estimation.estimators.parameters import ParameterLayout
from jointid.estimation.estimators.problem import fitted_layout, make_problem
from jointid.estimation.estimators.whitened_residual import WhitenedResidual
from jointid.exporting.identification import to_json, to_toml
from jointid.exporting.matlab import to_mat
from jointid.phasors.extract import extract_phasors
from jointid.simulation.closed_loop import Campaign, simulate_campaign, with_inertia_error

PAYLOAD = np.array([[0.0012, 0.0005], [0.0005, 0.0009]])
TRUTH = np.concatenate([PAPER.K, PAPER.D])
GAIN = np.array([1.07, 0.95])


def campaign(seed: int, *, added: np.ndarray | None = PAYLOAD, error: float = 0.1) -> Campaign:
    return simulate_campaign(
        PARALLELOGRAM,
        PAPER,
        np.geomspace(3, 30, 8),
        inertia_error=error,
        added=added,
        seed=seed,
        excitation=Excitation(duration_s=1.0),
        controller=Controller(bandwidth_hz=5.0, sample_rate_hz=2000.0),
        measurement=Measurement(encoder_counts=65536, torque_noise_Nm=0.02, torque_gain=GAIN),
    )


def unknown(made: Campaign) -> Study:
    """A study of which neither inertias nor torque scale are known."""
    return Study(**made._asdict(), inertia_std=math.inf, torque_std=math.inf)


@pytest.mark.parametrize("seed", range(4))
def test_a_known_payload_fixes_the_absolute_scale(seed: int) -> None:
    fit = analyse(unknown(campaign(seed))).fit
    assert np.abs((fit.estimate - TRUTH) / fit.standard_error).max() < 4
    assert (fit.standard_error / TRUTH).max() < 0.01
    assert fit.torque_scale == pytest.approx(1 / GAIN, rel=0.005)
    assert pytest.approx(PARALLELOGRAM.M2, rel=0.01) == fit.inertias[0].M2
    assert pytest.approx(PAYLOAD, rel=1e-9) == fit.inertias[-1].M2 - fit.inertias[0].M2


def test_the_uncertain_part_of_a_loaded_inertia_is_named() -> None:
    analysis = analyse(unknown(campaign(0)))
    rows = {row.name: row for row in analysis.priors}
    rest = [f"{name} without addition" for name in ("J_a1", "J_12", "J_a2")]
    assert list(rows) == ["J_m1", "J_m2", *rest, "torque scale 1", "torque scale 2"]
    assert rows[rest[0]].fitted == analysis.inertia().M2[0, 0]
    assert not math.isfinite(rows[rest[0]].given_std)
    study = analysis.study
    alone = replace(study, records=[r for r in study.records if r.pose is None])
    assert "J_a1" in {row.name for row in analyse(alone, method="weighted").priors}


def test_unknown_inertias_and_torques_are_exported_in_words() -> None:
    analysis = analyse(unknown(campaign(0)))
    obtained = json.loads(to_json(analysis))["obtained"]
    assert (obtained["inertia_std"], obtained["torque_std"]) == (None, None)
    assert to_toml(analysis).count('_std = "unknown"') == 2
    struct = loadmat(BytesIO(to_mat(analysis)), simplify_cells=True)["identification"]["obtained"]
    assert struct["inertia_std"] == struct["torque_std"] == math.inf
    unstated = replace(analysis, study=replace(analysis.study, torque_std=None))
    assert "torque_std" not in json.loads(to_json(unstated))["obtained"]


@pytest.mark.parametrize("seed", range(2))
def test_without_a_payload_the_absolute_scale_is_undetermined(seed: int) -> None:
    fit = analyse(unknown(campaign(seed, added=None))).fit
    assert np.all(np.isinf(fit.standard_error))


def test_an_unknown_payload_does_not_determine_the_scale() -> None:
    """The same records, with the payload in M2 but not as its exact part."""
    made = campaign(0)
    loaded = made.poses["loaded"]
    poses = {"loaded": Inertia(loaded.M, loaded.M2)}
    fit = analyse(unknown(made._replace(poses=poses))).fit
    assert np.all(np.isinf(fit.standard_error))


def test_linear_estimators_take_a_payload_as_exact() -> None:
    """Their error from the inertias is that of the uncertain part alone."""
    phasors = extract_phasors(campaign(0).records)
    count = len(phasors.labels) // 2
    free = Inertia(PARALLELOGRAM.M, PARALLELOGRAM.M2 + PAYLOAD)
    errors = []
    for loaded in (PARALLELOGRAM.with_added(PAYLOAD), free):
        given = [PARALLELOGRAM] * count + [loaded] * count
        prior = InertiaPrior.of(given, *phasors.q.shape, inertia_std=0.05)
        assert len(prior.rest) == (1 if loaded.added.any() else 2)
        assert pytest.approx(np.array([PARALLELOGRAM.M2, free.M2])) == prior.M2
        errors.append(prior.blocks()["M2"][1])
    assert errors[0] == pytest.approx(errors[1][:1])


def test_the_gradient_is_that_of_the_cost() -> None:
    """Against central differences; both poses act on the one uncertain matrix."""
    made = campaign(1)
    phasors, given = extract_phasors(made.records), Study(**made._asdict()).inertias
    prior = InertiaPrior.of(given, *phasors.q.shape, inertia_std=0.1, torque_std=0.1)
    noise = spring_equations(phasors, given).noise
    start, layout = ParameterLayout.of(2).named(TRUTH), fitted_layout(prior, None, delay=False)
    problem = make_problem(phasors, prior, layout, start, None, noise)
    p = 1.01 * problem.start(start)
    scale = np.ones(problem.s.shape[1])
    _, gradient, _ = quadratic(WhitenedResidual.of(problem, p, scale), p)
    for k in range(p.size):
        step = 1e-5 * p[k] * np.eye(p.size)[k]
        ahead, behind = (
            quadratic(WhitenedResidual.of(problem, at, scale), at)[0] for at in (p + step, p - step)
        )
        assert (ahead - behind) / (4e-5 * p[k]) == pytest.approx(gradient[k], rel=1e-4)


def test_simulated_inertia_errors_are_as_specified() -> None:
    for seed in range(5):
        given = with_inertia_error(PARALLELOGRAM.with_added(PAYLOAD), 0.3, seed)
        assert np.abs(given.M / PARALLELOGRAM.M - 1) == pytest.approx(0.3)
        assert given.added.tolist() == PAYLOAD.tolist()
        own = (given.M2 - PAYLOAD) / PARALLELOGRAM.M2
        assert np.abs(np.diag(own) - 1) == pytest.approx(0.3)
    assert len({tuple(with_inertia_error(PARALLELOGRAM, 0.3, seed).M) for seed in range(20)}) == 4
    with pytest.raises(JointIdError, match="inertia_error = 1"):
        with_inertia_error(PARALLELOGRAM, 1.0)


def test_the_records_are_those_of_the_robot_not_of_the_study() -> None:
    right, wrong = campaign(0, error=0.0), campaign(0)
    assert right.inertia.M2.tolist() == PARALLELOGRAM.M2.tolist()
    assert all(
        np.array_equal(a.tau_Nm, b.tau_Nm) for a, b in zip(right.records, wrong.records, strict=True)
    )
    assert [record.pose for record in wrong.records] == [None] * 16 + ["loaded"] * 16
    progress: list[float] = []
    simulate_campaign(PARALLELOGRAM, PAPER, [5.0], added=PAYLOAD, progress=progress.append)
    assert progress == sorted(progress)
    assert progress[-1] == 1.0


@pytest.mark.parametrize(
    ("added", "said"),
    [
        ([[1, 0], [1, 1]], "added must be symmetric"),
        ([[1.0]], r"added has shape \(1, 1\)"),
        ([[0.01, 0], [0, 0.01]], r"M2 − added \(M2 is the total\) must be positive definite"),
        ("heavy", "added .* expected real numbers"),
    ],
)
def test_an_impossible_payload_is_refused(added: object, said: str) -> None:
    with pytest.raises(JointIdError, match=said):
        Inertia(PARALLELOGRAM.M, PARALLELOGRAM.M2, added=added)  # type: ignore[arg-type]


def test_payloads_add_up() -> None:
    twice = PARALLELOGRAM.with_added(PAYLOAD).with_added(PAYLOAD)
    assert pytest.approx(PARALLELOGRAM.M2 + 2 * PAYLOAD) == twice.M2
    assert twice.added == pytest.approx(2 * PAYLOAD)
    assert not PARALLELOGRAM.added.any()
    without = twice.with_added(-PAYLOAD)
    assert pytest.approx(PARALLELOGRAM.M2 + PAYLOAD) == without.M2
