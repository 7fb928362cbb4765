"""Prediction of records left out of the fit: what a stiffness is worth for another motion."""

from collections.abc import Sequence

import numpy as np

from jointid.arm_side.band_limited import distinct
from jointid.arm_side.identify import identify_arm_side
from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.records import MotionRecord
from jointid.robot_models.model import RobotModel

_MOST = 3
"""Records left out in turn, spread over all; each takes another fit."""


def left_out_error(records: Sequence[MotionRecord], robot: RobotModel) -> Floats:
    """Return the root mean square error of the deflection predicted for records left out, (n,), rad.

    It covers each record's used samples. NaN for a joint that the other records do not determine, and
    for fewer than two records with sensors.
    """
    sensed = distinct([record for record in records if record.arm_rad is not None])
    squares = []
    for k in np.unique(np.linspace(0, len(sensed) - 1, _MOST).round().astype(int)).tolist():
        record, others = sensed[k], [*sensed[:k], *sensed[k + 1 :]]
        try:
            fit = identify_arm_side(others, robot, jackknife=False)
            _, measured, predicted = fit.deflection(record)
        except JointIdError:  # without this record, there is no fit
            continue
        squares.append(
            np.where(np.isfinite(fit.K), np.mean((measured - predicted) ** 2, axis=0), np.nan)
        )
    found = np.array(squares).reshape(-1, robot.n)
    known = np.isfinite(found)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(np.where(known, found, 0.0).sum(axis=0) / known.sum(axis=0)))
