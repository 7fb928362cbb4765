"""Digests of two studies differ exactly if the studies differ."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from jointid import Elasticity, Inertia, RobotModel, SineRecord, Study
from jointid.files.digest import study_digest
from jointid.files.study_files import load_study, pack_study
from tests.robots import SIX_AXES

TIME = np.arange(4000) / 1000.0


def study(**changes: object) -> Study:
    record = SineRecord(
        frequency_hz=3.0,
        time_s=TIME,
        theta_rad=np.sin(2 * np.pi * 3 * TIME)[:, None] * [1.0, 0.5],
        tau_Nm=np.cos(2 * np.pi * 3 * TIME)[:, None] * [1.0, 0.5],
        label="a",
    )
    made = Study(
        records=(record,),
        inertia=Inertia([0.0025, 0.001], [[0.004, 0.0004], [0.0004, 0.002]]),
        nominal=Elasticity([20.0, 3.5], [0.1, 0.015]),
        name="cell",
        poses={"p": Inertia([0.0025, 0.001], [[0.005, 0.0004], [0.0004, 0.002]])},
    )
    return replace(made, **changes)


def changed_record(**changes: object) -> Study:
    record = study().records[0]
    fields = ("frequency_hz", "time_s", "theta_rad", "tau_Nm", "torque_hold", "torque_delay_s")
    kept = {name: getattr(record, name) for name in (*fields, "start_s", "pose", "label")}
    return study(records=(SineRecord(**(kept | changes)),))


def nudged(array: np.ndarray, index: int) -> np.ndarray:
    copy = array.copy()
    copy[index] = np.nextafter(copy[index], np.inf)
    return copy


def test_equal_studies_have_equal_digests() -> None:
    assert study_digest(study()) == study_digest(study())


def test_any_single_difference_changes_the_digest() -> None:
    record = study().records[0]
    others = [
        study(name="cel"),
        study(description="x"),
        study(origin="measured"),
        study(nominal=None),
        study(nominal=Elasticity([20.0, 3.5], [0.1, 0.0150001])),
        study(inertia=Inertia([0.0025, 0.001], [[0.004, 0.0005], [0.0005, 0.002]])),
        study(poses={}),
        study(inertia_std=0.06),
        study(inertia_std=float("inf")),
        study(torque_std=0.0),
        study(torque_std=0.05),
        study(inertia_std=0.0, torque_std=0.05),
        study(poses={"p": Inertia([0.0025, 0.001], study().poses["p"].M2, [[0.001, 0], [0, 0]])}),
        study(poses={"p": Inertia([0.0025, 0.001], study().poses["p"].M2, [[0, 0], [0, 0.001]])}),
        study(poses={"q": study().poses["p"]}),
        study(records=study().records * 2),
        changed_record(frequency_hz=3.0000001),
        changed_record(torque_hold=True),
        changed_record(torque_delay_s=1e-6),
        changed_record(start_s=0.0),
        changed_record(pose="p"),
        changed_record(label="b"),
        changed_record(time_s=TIME + 1.0),
        changed_record(theta_rad=nudged(record.theta_rad, 2717)),
        changed_record(tau_Nm=nudged(record.tau_Nm, 3999)),
        changed_record(theta_rad=record.tau_Nm, tau_Nm=record.theta_rad),
    ]
    digests = [study_digest(s) for s in (study(), *others)]
    assert len(set(digests)) == len(digests)


@pytest.mark.parametrize(("first", "second"), [(("ab", "c"), ("a", "bc")), (("", "x"), ("x", ""))])
def test_adjacent_texts_are_separated_in_the_digest(
    first: tuple[str, str], second: tuple[str, str]
) -> None:
    one, two = (study(name=n, description=d) for n, d in (first, second))
    assert study_digest(one) != study_digest(two)


def test_the_memory_layout_does_not_change_the_digest() -> None:
    record = study().records[0]
    assert study_digest(
        changed_record(theta_rad=np.ascontiguousarray(record.theta_rad))
    ) == study_digest(study())


def test_a_stored_robot_model_has_the_digest_of_its_file_of_any_name() -> None:
    """A study is stored with robot.toml; a changed digest would count as a damaged copy."""
    robot = RobotModel.parse("my cell.toml", SIX_AXES.encode())
    record = study().records[0]
    many = replace(record, theta_rad=np.tile(record.theta_rad, 3), tau_Nm=np.tile(record.tau_Nm, 3))
    angles = {"": np.radians([0.0, -60, 60, 0, 45, 0])}
    made = Study(
        records=(many,), inertia=robot.inertia(angles[""]), robot_model=robot, pose_angles_rad=angles
    )
    assert study_digest(load_study(pack_study(made, record_format="parquet"))) == study_digest(made)
