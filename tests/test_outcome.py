"""Path error before and after an identification: known answers, scaling laws, choice of the arm."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plants import ONE, PAPER, PARALLELOGRAM, SERIAL, THREE, THREE_SPRINGS
from random_cases import examples

from jointid import Elasticity, Inertia, JointIdError, PlanarArm, Study, analyse, rectangle
from jointid.cut.outcome import (
    TYPICAL_SERVO,
    cut_outcome,
    cut_with_laws,
    millimetres,
    remaining_error_text,
    study_outcome,
    with_laws_text,
)
from jointid.cut.robot import CUTTING_POINT_M, CutFriction, CutRobot, assumed_elasticity, cut_robot
from jointid.cut.servo import Servo
from jointid.cut.tracking import track
from jointid.gears.gear import Gear

PATH = rectangle(zone_m=0.010)
IDEAL = Servo()
OTHER = Inertia(M=[0.0013, 0.0013], M2=[[0.0023, 0.0035], [0.0035, 0.0071]])
MICROMETRE = 1e-6


def analysis_of(
    inertia: Inertia = PARALLELOGRAM,
    identified: Elasticity = PAPER,
    nominal: Elasticity | None = None,
    relative_error: float = 0.01,
    friction: Any = None,
) -> Any:
    """An analysis as far as an outcome looks at it."""
    value = np.concatenate([identified.K, identified.D])
    fit = SimpleNamespace(
        n=identified.n,
        elasticity=identified,
        estimate=value,
        covariance=np.diag((relative_error * value) ** 2),
        friction=friction,
        gears=(),
    )
    study = SimpleNamespace(inertia=inertia, nominal=nominal, poses={})
    return SimpleNamespace(study=study, fit=fit, findings=())


def robot(relative_error: float = 0.0, drive: Any = "parallelogram") -> CutRobot:
    value = np.concatenate([PAPER.K, PAPER.D])
    covariance = np.diag((relative_error * value) ** 2)
    return CutRobot("direct", PlanarArm.example(drive), PAPER, covariance, None, None)


def scaled(ratio: float) -> Elasticity:
    return Elasticity(ratio * PAPER.K, PAPER.D)


def test_both_cuts_have_the_nonlinear_gears_and_a_servo_may_compensate_them() -> None:
    hard = replace(robot(), gears=(Gear(cubic=9000.0), Gear()))
    outcome = cut_outcome(hard, PATH, PAPER, samples=2)
    run = cut_with_laws(hard, outcome.toolpath)
    known = run.max_contour_error_m
    assert f"assumes these laws as well, the path error is {millimetres(known)}." in with_laws_text(run)
    assert outcome.after_m > 5 * known
    assert not outcome.depends_on_elasticity
    text = remaining_error_text(replace(outcome, before=run))
    assert text.endswith("K and D alone do not describe these gears.")  # no coincidence


def test_the_long_step_changes_the_path_error_by_less_than_a_micrometre() -> None:
    rubbing = CutFriction(coulomb=(0.4, 0.08), viscous=(0.002, 0.0005))
    cut = cut_outcome(robot(0.001), PATH, scaled(0.9), friction=rubbing, samples=5).before
    fine = track(
        PlanarArm.example(), PATH, PAPER, scaled(0.9), servo=TYPICAL_SERVO, friction=rubbing, dt=5e-5
    )
    np.testing.assert_allclose(np.diff(cut.time_s), 5e-4)
    assert abs(cut.max_contour_error_m - fine.max_contour_error_m) < MICROMETRE


def test_a_stiff_arm_gets_a_shorter_step_and_its_distribution() -> None:
    """Its fastest mode has 1400 rad/s: a step of 0.5 ms does not resolve it."""
    stiff = replace(robot(0.001), elasticity=scaled(70.0))
    outcome = cut_outcome(stiff, PATH, None, samples=5)
    np.testing.assert_allclose(np.diff(outcome.before.time_s), 2.5e-4)
    assert outcome.distribution is not None
    with pytest.raises(JointIdError, match="too long for this arm"):
        track(stiff.arm, PATH, stiff.elasticity, servo=TYPICAL_SERVO, dt=5e-4)


class TestTheArm:
    @pytest.mark.parametrize(
        ("inertia", "drive"), [(PARALLELOGRAM, "parallelogram"), (SERIAL, "serial")]
    )
    def test_a_study_with_the_inertias_of_an_example_arm_gets_it(
        self, inertia: Inertia, drive: str
    ) -> None:
        found = cut_robot(analysis_of(inertia, nominal=scaled(0.5)))
        assert (found.rule, found.arm.drive) == ("direct", drive)
        np.testing.assert_array_equal(found.elasticity.K, PAPER.K)
        np.testing.assert_array_equal(found.nominal.K, 0.5 * PAPER.K)
        at_cut = found.arm.inertia(found.arm.inverse(CUTTING_POINT_M))
        np.testing.assert_allclose(at_cut.M2, inertia.M2, rtol=2e-3)

    def test_the_other_drive_is_stated_to_be_another_robot(self) -> None:
        found = cut_robot(analysis_of(PARALLELOGRAM), drive="serial")
        assert (found.rule, found.arm.drive) == ("springs", "serial")
        np.testing.assert_array_equal(found.elasticity.D, PAPER.D)

    @pytest.mark.parametrize(
        ("factor", "rule"), [(1.03, "direct"), (1.08, "relative"), (0.9, "relative")]
    )
    def test_inertias_count_as_the_same_within_five_per_cent(self, factor: float, rule: str) -> None:
        inertia = Inertia(PARALLELOGRAM.M, factor * PARALLELOGRAM.M2)
        assert cut_robot(analysis_of(inertia)).rule == rule

    def test_a_pose_may_be_the_one_that_matches(self) -> None:
        analysis = analysis_of(OTHER)
        analysis.study.poses = {"cutting": PARALLELOGRAM}
        assert cut_robot(analysis).rule == "direct"

    def test_gear_ratios_of_another_robot_are_kept(self) -> None:
        identified = Elasticity([8.0, 58.0], [0.01, 0.04])
        nominal = Elasticity([10.0, 50.0], [0.02, 0.03])
        friction = SimpleNamespace(coulomb=np.array([0.08, 0.58]), viscous=np.array([-1e-6, 2e-3]))
        analysis = analysis_of(OTHER, identified, nominal, 0.02, friction)
        found = cut_robot(analysis)
        assert found.rule == "relative"
        np.testing.assert_allclose(found.elasticity.K, PAPER.K)
        np.testing.assert_allclose(found.nominal.K / found.elasticity.K, nominal.K / identified.K)
        np.testing.assert_allclose(found.nominal.D / found.elasticity.D, nominal.D / identified.D)
        np.testing.assert_allclose(found.elasticity.D / found.elasticity.K, identified.D / identified.K)
        value = np.concatenate([found.elasticity.K, found.elasticity.D])
        np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)) / value, 0.02)
        np.testing.assert_allclose(found.friction.coulomb / found.elasticity.K, 0.01)
        assert found.friction.viscous[0] == 0
        np.testing.assert_allclose(found.of_the_study(found.elasticity).K, identified.K)
        np.testing.assert_allclose(found.of_the_study(found.nominal).D, nominal.D)

    def test_custom_values_are_in_the_studys_units(self) -> None:
        """A servo with the identified values cuts as after the identification."""
        identified = Elasticity([55.0, 11.0], [0.12, 0.02])
        found = cut_robot(analysis_of(OTHER, identified, None, 1e-4))
        assumed = assumed_elasticity(found, "custom", identified)
        np.testing.assert_allclose(assumed.K, found.elasticity.K)
        np.testing.assert_allclose(assumed.D, found.elasticity.D)
        friction = SimpleNamespace(coulomb=[0.5, 0.25], viscous=[0.0, 0.0])
        outcome = cut_outcome(found, PATH, assumed, friction=friction, samples=10)
        assert outcome.before_m > 1e-4
        assert outcome.before_m == pytest.approx(outcome.after_m, rel=0.02)
        half = Elasticity(0.5 * identified.K, 0.5 * identified.D)
        np.testing.assert_allclose(assumed_elasticity(found, "custom", half).K, 0.5 * found.elasticity.K)

    @pytest.mark.parametrize(
        ("inertia", "springs"), [(ONE, Elasticity([43], [0.1])), (THREE, THREE_SPRINGS)]
    )
    def test_studies_without_two_joints_do_not_mention_a_plane(
        self, inertia: Inertia, springs: Elasticity
    ) -> None:
        analysis = analysis_of(inertia, springs, nominal=springs)
        found = cut_robot(analysis)
        assert found.rule == "demonstration"
        assert found.nominal is None
        np.testing.assert_array_equal(found.elasticity.K, PAPER.K)
        assert study_outcome(analysis) is None


class TestTheServoBefore:
    def test_the_options_depend_on_the_study(self) -> None:
        found = cut_robot(analysis_of(nominal=scaled(0.5)))
        assert assumed_elasticity(found, "rigid") is None
        np.testing.assert_allclose(assumed_elasticity(found, "study").K, 0.5 * PAPER.K)
        np.testing.assert_allclose(assumed_elasticity(found, "soft").K, 0.4 * PAPER.K)
        np.testing.assert_allclose(assumed_elasticity(found, "stiff").K, 3 * PAPER.K)
        np.testing.assert_array_equal(assumed_elasticity(found, "stiff").D, PAPER.D)
        assert assumed_elasticity(found, "custom", scaled(2)).K[0] == 86

    @pytest.mark.parametrize(
        ("assumption", "said"),
        [("study", r"study's \[nominal\] has no"), ("custom", "custom controller"), ("best", '"soft"')],
    )
    def test_missing_values_are_stated(self, assumption: Any, said: str) -> None:
        with pytest.raises(JointIdError, match=said):
            assumed_elasticity(robot(), assumption)


class TestKnownAnswers:
    @pytest.mark.parametrize("drive", ["parallelogram", "serial"])
    def test_a_servo_with_the_true_elasticity_has_no_path_error(self, drive: str) -> None:
        outcome = cut_outcome(robot(drive=drive), PATH, PAPER, servo=IDEAL, samples=3)
        assert outcome.before_m < 2 * MICROMETRE
        assert outcome.after_m < 2 * MICROMETRE
        np.testing.assert_array_equal(outcome.before.reference_m, outcome.after.reference_m)

    def test_k_within_one_per_cent_and_d_within_five(self) -> None:
        found = robot()
        spread = np.array([0.005, 0.005, 0.025, 0.025]) * np.concatenate([PAPER.K, PAPER.D])
        found = CutRobot("direct", found.arm, PAPER, np.diag(spread**2), None, None)
        outcome = cut_outcome(found, PATH, None, servo=IDEAL)
        assert outcome.after_m < 6e-5
        assert outcome.distribution.median_m < outcome.after_m < outcome.before_m / 30


class TestThePromise:
    def test_it_grows_with_the_uncertainty(self) -> None:
        small, large = (
            cut_outcome(robot(error), PATH, None, servo=IDEAL, samples=20) for error in (2e-3, 2e-2)
        )
        assert large.after_m == pytest.approx(10 * small.after_m, rel=0.15)
        assert large.before_m == small.before_m

    def test_the_robot_drawn_stands_at_its_edge(self) -> None:
        outcome = cut_outcome(robot(0.01), PATH, None, samples=60)
        drawn = outcome.distribution.max_contour_error_m
        assert np.mean(drawn <= outcome.after_m) == pytest.approx(0.95, abs=0.02)
        assert outcome.after.max_contour_error_m == pytest.approx(outcome.after_m, rel=0.05)

    def test_without_the_95th_percentile_the_cut_is_still_simulated(self) -> None:
        outcome = cut_outcome(robot(5.0), PATH, None, servo=IDEAL)
        assert outcome.distribution is None
        assert "not determined well enough" in outcome.problem
        assert outcome.after_m == outcome.after.max_contour_error_m < 2 * MICROMETRE

    def test_friction_acts_before_and_after(self) -> None:
        friction = SimpleNamespace(coulomb=[0.5, 0.25], viscous=[0.0, 0.0])
        without = cut_outcome(robot(), PATH, None, samples=2)
        with_friction = cut_outcome(robot(), PATH, None, friction=friction, samples=2)
        assert with_friction.after_m > without.after_m + 1e-4
        assert not np.array_equal(with_friction.before.tool_m, without.before.tool_m)

    def test_where_friction_dominates_the_elasticity_does_not_change_the_error(self) -> None:
        friction = SimpleNamespace(coulomb=[0.5, 0.25], viscous=[0.0, 0.0])
        rough = cut_outcome(robot(1e-4), PATH, None, friction=friction, samples=30)
        drawn = rough.distribution.max_contour_error_m
        assert rough.spread_m == pytest.approx(np.percentile(drawn, 95) - np.percentile(drawn, 5))
        assert rough.spread_m < 0.01 * rough.after_m
        assert not rough.depends_on_elasticity
        uncertain = cut_outcome(robot(0.02), PATH, None, samples=30)
        assert uncertain.spread_m > 0.1 * uncertain.after_m
        assert uncertain.depends_on_elasticity
        unknown = cut_outcome(robot(5.0), PATH, None)
        assert np.isnan(unknown.spread_m)
        assert unknown.depends_on_elasticity
        assert not unknown.not_better

    def test_a_result_that_is_not_better_is_stated(self) -> None:
        """With the true K before, the 95th percentile of the uncertain robots is worse."""
        right = cut_outcome(robot(0.02), PATH, robot(0.02).elasticity, samples=30)
        assert right.before_m < right.after_m
        assert "not smaller" in right.not_better
        assert not cut_outcome(robot(0.02), PATH, None, samples=30).not_better


class TestAStudy:
    @pytest.mark.parametrize(("error", "told"), [(0.3, False), (0.4, True), (200.0, True)])
    def test_a_study_with_undetermined_elasticity_gets_no_path_error(
        self, error: float, told: bool
    ) -> None:
        """K = 0 ± 7000 and "3.1 mm → under 0.001 mm" must not be on one page."""
        analysis = analysis_of(relative_error=error)
        if not told:
            assert cut_robot(analysis).rule == "direct"
            return
        with pytest.raises(JointIdError, match=r"K1, K2, D1 and D2 are not known.*more than a third"):
            study_outcome(analysis)

    def test_a_negative_damping_is_stated_as_identified(self) -> None:
        analysis = analysis_of(relative_error=2.0)
        analysis.fit.elasticity = replace(PAPER, D=np.zeros(2))
        analysis.fit.estimate[2] = -0.1
        analysis.fit.covariance = np.diag([1e-6, 1e-6, 0.04, 0.04])
        with pytest.raises(JointIdError, match=r"D1 and D2 are .*: D1 = −0\.1 ± 0\.2"):
            cut_robot(analysis)

    def test_a_study_with_a_problem_gets_no_path_error_and_names_it(self) -> None:
        analysis = analysis_of()
        analysis.findings = (SimpleNamespace(level="problem", title="The sign looks reversed"),)
        with pytest.raises(JointIdError, match="The sign looks reversed"):
            cut_robot(analysis)

    def test_the_stated_error_is_that_of_the_cut_shown(self, studies: dict[int, Study]) -> None:
        outcome = study_outcome(analyse(studies[2], method="weighted"))
        assert outcome.after_m == outcome.after.max_contour_error_m

    def test_of_two_joints_gains_millimetres(self, studies: dict[int, Study]) -> None:
        outcome = study_outcome(analyse(replace(studies[2], inertia_std=0.0), method="weighted"))
        assert outcome.robot.rule == "direct"
        assert outcome.before_m > 1.5e-3
        assert outcome.after_m < 1e-4
        np.testing.assert_array_equal(outcome.assumed.K, studies[2].nominal.K)

    def test_without_nominal_values_is_compared_with_rigid_joints(self) -> None:
        outcome = study_outcome(analysis_of(nominal=None))
        assert outcome.assumed is None
        assert outcome.before_m > 2e-3


@pytest.mark.parametrize(
    ("length_m", "text"),
    [
        (0.0, "under 0.001 mm"),
        (0.99e-6, "under 0.001 mm"),
        (2.9e-6, "0.003 mm"),
        (3.94e-5, "0.039 mm"),
        (3.1e-3, "3.1 mm"),
        (0.0123, "12 mm"),
    ],
)
def test_millimetres(length_m: float, text: str) -> None:
    assert millimetres(length_m) == text


@examples(50, derandomize=True)
@given(st.floats(1e-6, 0.099))
def test_millimetres_are_those_of_the_length(length_m: float) -> None:
    shown = float(millimetres(length_m).removesuffix(" mm"))
    assert shown == pytest.approx(1e3 * length_m, rel=0.5 if length_m < 1e-5 else 0.05)
