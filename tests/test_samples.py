"""The samples: the exercises and the fleet."""

import runpy
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest

from jointid import analyse, load_study, save_study
from jointid.analysis import NOT_USABLE, USABLE, WITH_CARE
from jointid.corrections.changes import corrected
from jointid.fleet.spread import fleet_spread, robot_drift
from jointid.fleet.table import read_fleet
from jointid.ui.study.plan_form import largest_so_far

SAMPLES = Path(__file__).parents[1] / "sample_data"


def test_the_failed_study_names_its_cause_and_the_remedy_corrects_it() -> None:
    study = load_study(SAMPLES / "exercise_1.zip")
    analysis = analyse(study)
    assert analysis.state == NOT_USABLE
    assert "torques of joints 1 and 2" in analysis.headline
    _, planned = largest_so_far(analysis)  # the velocity of an arm by wrong torques is no limit
    measured = np.abs(analysis.phasors.omega[:, None] * analysis.phasors.q).max(axis=0)
    assert planned == pytest.approx(measured, rel=1e-3)
    mended = analyse(corrected(study, analysis.findings[0].changes[0]))
    assert mended.state == USABLE
    assert np.all(np.abs(mended.fit.K - [43.0, 7.5]) < 4 * mended.fit.standard_error[:2])


def test_a_duplicated_record_makes_the_answer_usable_with_care_until_left_out() -> None:
    study = load_study(SAMPLES / "exercise_2.zip")
    analysis = analyse(study)
    assert analysis.state == WITH_CARE
    (change,) = analysis.findings[0].changes
    mended = corrected(study, change)
    assert len(mended.records) == len(study.records) - 1
    assert analyse(mended).state == USABLE


def test_the_fleet_has_a_soft_joint_and_one_that_wears() -> None:
    rows = read_fleet(SAMPLES / "fleet.parquet")
    spread = fleet_spread(rows, "K", 1, within_robot=False)
    out = {spread.rows[k].robot for k in np.flatnonzero(spread.outliers)}
    assert out == {"cell 3", "cell 6"}
    for robot in ("cell 1", "cell 3"):
        change, error = robot_drift(spread.rows, "K", 1, robot).per_year
        assert (abs(change) > 3 * error) == (robot == "cell 3")


@pytest.mark.parametrize("name", ["exercise_1", "manutec_r3"])
def test_the_script_makes_the_samples(tmp_path: Path, name: str) -> None:
    """Its imports were out of date, and the description of a study differed."""
    made = runpy.run_path(str(SAMPLES / "make_samples.py"))[name]()
    save_study(made, tmp_path / name)
    with ZipFile(SAMPLES / f"{name}.zip") as sample:
        for member in sample.namelist():
            assert (tmp_path / name / member).read_bytes() == sample.read(member)
