"""Two studies side by side: differences with their errors, and the page that shows them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from streamlit.testing.v1 import AppTest

from jointid import Analysis, JointIdError, Study, analyse
from jointid.uncertainty.comparison import compare


@pytest.fixture(scope="module")
def first(studies: dict[int, Study]) -> Analysis:
    return analyse(studies[2])


def test_a_study_does_not_differ_from_itself(first: Analysis) -> None:
    rows = compare(first.fit, first.fit)
    assert [row.first.name for row in rows] == ["K1", "K2", "D1", "D2"]
    assert all(row.relative == row.sigmas == 0 for row in rows)
    assert all(np.isnan(row.sigmas) for row in compare(first.fit, first.fit, same_records=True))


def test_a_stiffer_gear_is_found_with_its_standard_errors(first: Analysis) -> None:
    """Torques 2 % larger scale K and D by as much; errors of both studies add as squares."""
    records = [replace(r, tau_Nm=1.02 * r.tau_Nm) for r in first.study.records]
    inertia = replace(
        first.study.inertia, M=1.02 * first.study.inertia.M, M2=1.02 * first.study.inertia.M2
    )
    second = analyse(replace(first.study, records=records, inertia=inertia))
    rows = compare(first.fit, second.fit)
    for row in rows:
        assert row.relative == pytest.approx(0.02, rel=1e-4)
        error = np.hypot(row.first.error, row.second.error)
        assert row.sigmas == pytest.approx((row.second.value - row.first.value) / error)
    swapped = compare(second.fit, first.fit)
    assert [row.sigmas for row in swapped] == pytest.approx([-row.sigmas for row in rows])


def test_other_joints_are_refused(studies: dict[int, Study], first: Analysis) -> None:
    with pytest.raises(JointIdError, match="first study has 2 joints, the second 1 joint"):
        compare(first.fit, analyse(studies[1]).fit)


def test_the_page_compares_two_studies(app: AppTest) -> None:
    app.query_params["study"] = "paper"
    at = app.switch_page("pages/11_Compare.py").run()
    assert not at.exception, at.exception[0].stack_trace
    at = at.selectbox(key="compare_study").set_value("paper").run()
    at = at.selectbox(key="compare_estimator").set_value("least-squares").run()
    assert not at.exception, at.exception[0].stack_trace
    assert at.header[0].value.startswith("The stiffnesses differ by at most")
    at = at.selectbox(key="compare_study").set_value("one joint").run()
    assert "1 joint" in at.error[0].value
