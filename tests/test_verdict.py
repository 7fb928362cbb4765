"""Findings: silent about sound data, and each kind of unsound data by its name with a remedy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from plants import BAND_HZ, PAPER, SERIAL, campaign, steady_records

from jointid import Analysis, Finding, Inertia, SineRecord, Study, analyse

FREQUENCIES, TORQUES = campaign(BAND_HZ, 2)


def analysed(records: list[SineRecord], inertia: Inertia = SERIAL, **settings: Any) -> Analysis:
    return analyse(Study(records, inertia), **settings)


def sound(**changes: Any) -> list[SineRecord]:
    settings: dict[str, Any] = {"noise": (1e-5, 3e-3), "periods": 20.37, "seed": 3}
    return steady_records(SERIAL, PAPER, FREQUENCIES, TORQUES, **{**settings, **changes})


def remade(record: SineRecord, **changes: Any) -> SineRecord:
    fields = ("frequency_hz", "time_s", "theta_rad", "tau_Nm")
    return SineRecord(**{**{name: getattr(record, name) for name in fields}, **changes})


def titles(analysis: Analysis) -> str:
    return " | ".join(finding.title for finding in analysis.findings)


def unsound(analysis: Analysis) -> list[Finding]:
    return [finding for finding in analysis.findings if finding.level in ("problem", "warning")]


@pytest.mark.parametrize("periods", [3.3, 8.6, 20.37])
@pytest.mark.parametrize("seed", range(4))
def test_sound_data_raise_no_alarm(periods: float, seed: int) -> None:
    """Short records measure their own frequency badly; that is no contradiction."""
    analysis = analysed(sound(periods=periods, seed=seed, noise=(1e-4, 1e-2)), method="weighted")
    assert not unsound(analysis), titles(analysis)
    assert analysis.findings
    assert analysis.findings[0].level == "good"


def test_data_without_noise_raise_no_alarm() -> None:
    analysis = analysed(sound(noise=(0.0, 0.0)), method="weighted")
    assert not unsound(analysis), titles(analysis)


def test_every_finding_has_a_figure_and_a_remedy() -> None:
    records = sound()
    records[3] = remade(records[3], frequency_hz=records[3].frequency_hz * 1.01)
    wrong = analysed(records, Inertia(M=SERIAL.M, M2=SERIAL.M2 * 1.2))
    assert unsound(wrong)
    for finding in unsound(wrong):
        assert finding.title[0].isupper() or finding.title[0].isdigit()
        assert any(letter.isdigit() for letter in finding.detail)
        assert finding.remedy
    weights = [finding.weight for finding in wrong.findings]
    assert weights == sorted(weights, reverse=True)


@pytest.mark.parametrize(("factor", "level"), [(1.005, "warning"), (2.0, "problem"), (0.5, "problem")])
def test_wrong_frequency_is_found_and_the_record_named(factor: float, level: str) -> None:
    records = sound()
    records[4] = remade(
        records[4], frequency_hz=records[4].frequency_hz * factor, label="five.csv"
    )
    found = [f for f in analysed(records, method="weighted").findings if "frequency" in f.title]
    assert len(found) == 1
    assert found[0].level == level
    assert "five.csv" in found[0].detail
    assert "frequency_hz" in found[0].remedy


def test_transient_is_found_and_the_record_named() -> None:
    records = sound()
    time = records[6].time_s
    theta = records[6].theta_rad
    swing = 0.3 * np.abs(theta).max() * np.exp(-time / 0.2) * np.sin(2 * np.pi * 9.5 * time)
    records[6] = remade(records[6], theta_rad=theta + swing[:, None], label="seven.csv")
    found = [f for f in analysed(records, method="weighted").findings if "settling" in f.title]
    assert len(found) == 1
    assert "seven.csv" in found[0].detail
    assert "start_s" in found[0].remedy


def test_wrong_inertia_is_found() -> None:
    analysis = analysed(sound(), Inertia(M=SERIAL.M, M2=SERIAL.M2 * 1.1), method="weighted")
    assert analysis.fit.misfit > 3
    assert any("inertia" in finding.remedy.lower() for finding in unsound(analysis))


def test_untold_delay_is_found() -> None:
    records = sound(delay_s=0.004, told=False)
    analysis = analysed(records, method="weighted")
    assert any("delay" in (f.remedy + f.title + f.detail).lower() for f in unsound(analysis))


def test_reversed_torque_is_a_problem() -> None:
    records = [remade(record, tau_Nm=-record.tau_Nm) for record in sound()]
    analysis = analysed(records, method="least-squares")
    assert unsound(analysis)
    assert analysis.findings[0].level in ("problem", "warning")


def test_frequency_without_transfer_matrix_is_mentioned() -> None:
    analysis = analysed(sound()[:-1], method="weighted")
    found = [f for f in analysis.findings if "transfer matrix" in f.title]
    assert len(found) == 1
    assert "28.9 Hz" in found[0].detail
