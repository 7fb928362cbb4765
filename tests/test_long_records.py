"""Records larger than memory: reading in parts gives the same answer as reading at once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import jointid.files.record_tables as record_tables
import jointid.files.study_parts as study_parts
from jointid import (
    Controller,
    Elasticity,
    Inertia,
    JointIdError,
    MotorFriction,
    SineRecord,
    Study,
    analyse,
    extract_phasors,
    load_study,
    save_study,
    simulate_records,
)
from jointid.files.digest import study_digest
from jointid.phasors.fitted_sine import SineFit
from jointid.phasors.long_records import LongRecord, joined
from jointid.phasors.sine_fit import fit_sines
from jointid.simulation.experiment import Excitation
from jointid.ui.study.data_quality import quality_table

INERTIA = Inertia(M=[0.0025, 0.0010], M2=[[0.0041, 0.0004], [0.0004, 0.0019]])
TRUE = Elasticity(K=[43, 7.5], D=[0.1, 0.015])


@pytest.fixture
def short_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Everything is long, and a part is a few thousand samples."""
    monkeypatch.setattr(study_parts, "LONG_BYTES", 1 << 19)
    monkeypatch.setattr(study_parts, "_PART_SAMPLES", 4000)
    monkeypatch.setattr(study_parts, "_PART_PERIODS", 8)
    monkeypatch.setattr(record_tables, "_BATCH", 1777)


def noisy(frequency: float, samples: int, seed: int, jitter: float = 0.0) -> SineRecord:
    rng = np.random.default_rng(seed)
    time = np.arange(samples) / 1000 + jitter * rng.uniform(-1, 1, samples)
    turn = np.exp(1j * 2 * np.pi * frequency * time)
    q = np.outer(turn, [0.02 + 0.01j, -0.01j]).imag + 3e-5 * rng.standard_normal((samples, 2))
    tau = np.outer(turn, [1.0, 0.5j]).imag + 1e-3 * rng.standard_normal((samples, 2))
    return SineRecord(frequency, time, q + 0.3, tau)


def test_a_single_part_is_the_record() -> None:
    (fit,) = fit_sines([noisy(7.3, 4000, 1)])
    assert joined([fit], [4000]) is fit


@pytest.mark.usefixtures("short_parts")
@pytest.mark.parametrize("jitter", [0.0, 2e-4])
def test_parts_give_the_phasors_of_the_whole(tmp_path: Path, jitter: float) -> None:
    records = [noisy(f, 20_011, seed, jitter) for seed, f in enumerate((7.3, 11.9, 5.0))]
    save_study(Study(records, INERTIA), tmp_path / "study", record_format="parquet")
    long = load_study(tmp_path / "study").records
    assert all(isinstance(record, LongRecord) for record in long)
    whole, parts = extract_phasors(records), extract_phasors(long)
    assert quality_table(long, parts)["Samples"] == [20_011] * 3
    assert np.all(np.abs(parts.z - whole.z) < 0.5 * whole.standard_deviation)
    assert np.allclose(parts.duration_s, whole.duration_s, rtol=1e-4)
    assert np.allclose(parts.standard_deviation, whole.standard_deviation, rtol=0.5)
    assert np.allclose(parts.frequency_found_hz, whole.frequency_found_hz, atol=1e-4)
    assert np.allclose(parts.settling, whole.settling, atol=0.01)
    assert np.allclose(parts.drift, whole.drift, atol=1e-5)


@pytest.mark.usefixtures("short_parts")
def test_the_noise_of_parts_is_the_scatter_of_the_phasors(tmp_path: Path) -> None:
    """The standard deviation claimed is the one that the phasors of many records have."""
    records = [noisy(9.1, 14_000, seed) for seed in range(60)]
    save_study(Study(records, INERTIA), tmp_path / "study", record_format="parquet")
    phasors = extract_phasors(load_study(tmp_path / "study").records)
    claimed = np.sqrt((phasors.standard_deviation**2).mean(axis=0))
    seen = np.sqrt((np.abs(phasors.z - phasors.z.mean(axis=0)) ** 2).sum(axis=0) / 59)
    assert np.allclose(claimed, seen, rtol=0.25)


@pytest.mark.usefixtures("short_parts")
def test_a_long_study_gives_the_elasticity(tmp_path: Path) -> None:
    records = simulate_records(
        INERTIA,
        TRUE,
        [8, 25],
        excitation=Excitation(periods=30),
        controller=Controller(bandwidth_hz=8),
        friction=MotorFriction(coulomb=[0.05, 0.012], step_s=5e-4),
    )
    study = Study(records, INERTIA, name="long", origin="simulated")
    save_study(study, tmp_path / "study", record_format="parquet")
    long = load_study(tmp_path / "study")
    assert any(isinstance(record, LongRecord) for record in long.records)
    fit, whole = analyse(long).fit, analyse(study).fit
    assert fit.friction is not None
    assert np.allclose(fit.K, whole.K, rtol=3e-4)
    assert np.allclose(fit.D, whole.D, rtol=3e-3)
    assert np.allclose(fit.K, TRUE.K, rtol=1e-3)


@pytest.mark.usefixtures("short_parts")
def test_start_leaves_earlier_rows_out(tmp_path: Path) -> None:
    record = noisy(7.3, 20_000, 1)
    later = SineRecord(7.3, record.time_s, record.theta_rad, record.tau_Nm, start_s=6.0001)
    save_study(Study([later], INERTIA), tmp_path / "study", record_format="parquet")
    (long,) = load_study(tmp_path / "study").records
    assert isinstance(long, LongRecord)
    assert long.samples == later.samples
    assert long.time_s[0] == later.time_s[later.start]
    assert sum(part.samples for part in long.parts()) == later.samples
    whole, parts = extract_phasors([later]), extract_phasors([long])
    assert np.all(np.abs(parts.z - whole.z) < 0.5 * whole.standard_deviation)


@pytest.mark.usefixtures("short_parts")
@pytest.mark.parametrize(
    ("column", "value", "said"),
    [
        ("tau_m2_Nm", np.nan, "row 15001, column tau_m2_Nm: nan is not a finite number"),
        ("theta_m1_rad", None, "row 15001, column theta_m1_rad: the value is missing"),
        ("time_s", 3.0, "row 15001, column time_s: 3 s goes back from 14.999 s of row 15000"),
    ],
)
def test_faults_are_named_by_their_row(
    tmp_path: Path, column: str, value: float | None, said: str
) -> None:
    save_study(Study([noisy(7.3, 20_000, 1)], INERTIA), tmp_path / "study", record_format="parquet")
    file = tmp_path / "study" / "records" / "01.parquet"
    table = pq.read_table(file)
    values = table.column(column).to_pylist()
    values[15_000] = value
    table = table.set_column(
        table.schema.get_field_index(column), column, pa.array(values, pa.float64())
    )
    pq.write_table(table, file)
    long = load_study(tmp_path / "study")
    with pytest.raises(JointIdError, match=r"records/01\.parquet") as caught:
        extract_phasors(long.records)
    assert said in str(caught.value)


@pytest.mark.usefixtures("short_parts")
def test_a_long_study_has_the_digest_of_its_file_and_is_saved_complete(tmp_path: Path) -> None:
    save_study(Study([noisy(7.3, 20_000, 1)], INERTIA), tmp_path / "a", record_format="parquet")
    save_study(Study([noisy(7.3, 20_000, 2)], INERTIA), tmp_path / "b", record_format="parquet")
    a, again, b = (load_study(tmp_path / name) for name in ("a", "a", "b"))
    assert study_digest(a) == study_digest(again) != study_digest(b)
    with pytest.raises(JointIdError, match="copy the study's folder"):
        save_study(a, tmp_path / "c")


def test_noise_slower_than_a_part_is_in_the_error() -> None:
    """Eight parts whose amplitudes wander from part to part: the parts' scatter is the error."""
    rng = np.random.default_rng(4)
    time = np.arange(8000) / 1000
    claimed, seen = [], []
    for _ in range(60):
        parts = []
        for k in range(8):
            a = 1 + 0.01 * rng.standard_normal()
            wave = a * np.sin(2 * np.pi * 10 * time[:1000]) + 1e-4 * rng.standard_normal(1000)
            parts.append(SineRecord(10.0, time[1000 * k : 1000 * k + 1000], wave, wave))
        fit = joined(fit_sines(parts), [1000] * 8)
        claimed.append(fit.covariance[0, 0, 0].real)
        seen.append(abs(fit.fundamental[0] - 1) ** 2)
    assert np.mean(claimed) == pytest.approx(np.mean(seen), rel=0.4)
    assert fit.degrees_of_freedom == 7


def part_of(blocks: np.ndarray, middle_s: float = 0.0) -> SineFit:
    """Fit of a part from the phasors of its blocks, shape (b, 2n), as the scatter of blocks gives it."""
    mean, count = blocks.mean(axis=0), len(blocks)
    deviations = (blocks - mean) / count
    covariance = count / (count - 1) * deviations.T @ deviations.conj()
    zero = np.zeros(mean.size)
    return SineFit(mean, mean[None], zero, zero, middle_s, deviations, covariance[None], count - 1)


def test_parts_of_equal_blocks_have_the_scatter_of_all_blocks() -> None:
    """As if the record had been fitted as a whole: mean, deviations, covariance, degrees of freedom."""
    rng = np.random.default_rng(2)
    blocks = rng.standard_normal((3, 5, 2)) + 1j * rng.standard_normal((3, 5, 2))
    fits = [
        replace(part_of(each), middle_s=10.0 + k, offset=np.array([1.0 + 2 * k, 0.0]))
        for k, each in enumerate(blocks)
    ]
    found, whole = joined(fits, [500] * 3), part_of(blocks.reshape(15, 2))
    np.testing.assert_allclose(found.fundamental, whole.fundamental)
    np.testing.assert_allclose(found.harmonics, whole.harmonics)
    np.testing.assert_allclose(found.deviations, whole.deviations)
    np.testing.assert_allclose(found.covariance, whole.covariance)
    assert found.degrees_of_freedom == whole.degrees_of_freedom == 14
    assert found.middle_s == pytest.approx(11.0)
    np.testing.assert_allclose([found.offset, found.drift], [[3.0, 0.0], [2.0, 0.0]], atol=1e-12)


def test_longer_parts_count_more() -> None:
    rng = np.random.default_rng(3)
    fits = [part_of(rng.standard_normal((6, 2)).astype(complex), t) for t in (1.0, 3.0)]
    found = joined(fits, [300, 100])
    expected = 0.75 * fits[0].fundamental + 0.25 * fits[1].fundamental
    np.testing.assert_allclose(found.fundamental, expected)
    assert found.middle_s == pytest.approx(1.5)
    np.testing.assert_allclose(found.deviations.sum(axis=0), 0, atol=1e-12)


@pytest.mark.parametrize(("apart", "slow"), [(1.0, False), (30.0, True)])
def test_parts_further_apart_than_their_blocks_have_the_scatter_of_the_parts(
    apart: float, slow: bool
) -> None:
    """Four parts of five blocks; of the second channel they do not differ."""
    block = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    level = apart * np.array([-1.0, 1.0, -1.0, 1.0]) / 5
    fits = [part_of(np.column_stack([x + block, block]).astype(complex), t) for t, x in enumerate(level)]
    found = joined(fits, [10] * 4)
    variance = np.diag(found.covariance[0]).real
    of_parts = 4 / 3 * np.sum((level / 4) ** 2)
    of_blocks = 20 / 19 * np.sum(np.add.outer(level, block) ** 2) / 20**2
    assert variance[0] == pytest.approx(of_parts if slow else of_blocks)
    assert variance[1] == pytest.approx(20 / 19 * 4 * 10 / 20**2)
    assert found.degrees_of_freedom == (3 if slow else 19)
    assert np.allclose(found.covariance[0], found.covariance[0].conj().T)
