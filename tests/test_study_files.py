"""Studies on disk: exact round trips, and one clear error for an invalid study."""

from __future__ import annotations

import io
import os
import pickle
import stat
import struct
import time
import tomllib
import zipfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_cases import examples

from jointid import Elasticity, Inertia, JointIdError, SineRecord, Study
from jointid.files import container_limits as contained
from jointid.files import csv_tables, record_tables
from jointid.files.digest import study_digest
from jointid.files.study_files import lines_around, load_study, pack_study, save_study
from jointid.parsing import checked_toml

TOML = """\
format = 1
name = "Hand-written"
origin = "measured"

[inertia]
M = [0.0025, 0.0010]
M2 = [[0.004104, 0.000395], [0.000395, 0.001889]]

[nominal]
K = [20.0, 3.5]
D = [0.10, 0.015]

[timing]
torque_hold = true
torque_delay_s = 0.0005

[poses.stretched]
M2 = [[0.0081, 0.0021], [0.0021, 0.0019]]

[[records]]
file = "records/01.csv"
frequency_hz = 5.0
start_s = 0.1

[[records]]
file = "records/02.csv"
frequency_hz = 10
pose = "stretched"
label = "elbow leads"
torque_hold = false
"""
POSE = "M2 = [[0.0081, 0.0021], [0.0021, 0.0019]]"
HEADER = "time_s,theta_m1_rad,theta_m2_rad,tau_m1_Nm,tau_m2_Nm"


@cache
def csv_text(frequency_hz: float = 5.0, rows: int = 500, interval_s: float = 0.001) -> str:
    lines = [HEADER]
    for k in range(rows):
        phase = 2 * np.pi * frequency_hz * k * interval_s
        values = k * interval_s, 0.1 * np.sin(phase), 0.2 * np.cos(phase), np.cos(phase), np.sin(phase)
        lines.append(",".join(repr(float(v)) for v in values))
    return "\n".join(lines) + "\n"


def files(**changes: str | bytes | None) -> dict[str, bytes]:
    """The hand-written study, with files replaced (toml, first, second) or taken away (None)."""
    named = {"toml": "study.toml", "first": "records/01.csv", "second": "records/02.csv"}
    content: dict[str, str | bytes | None] = {
        "study.toml": TOML,
        "records/01.csv": csv_text(5.0),
        "records/02.csv": csv_text(10.0),
    }
    content |= {named[key]: value for key, value in changes.items()}
    return {k: v.encode() if isinstance(v, str) else v for k, v in content.items() if v is not None}


def zipped(content: dict[str, bytes], **options: int) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", **options) as archive:  # type: ignore[arg-type]
        for name, data in content.items():
            archive.writestr(name, data)
    return buffer.getvalue()


def written(folder: Path, content: dict[str, bytes]) -> Path:
    for name, data in content.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    return folder


def failure(source: object) -> str:
    with pytest.raises(JointIdError) as caught:
        load_study(source)  # type: ignore[arg-type]
    return str(caught.value)


def edited(old: str, new: str, text: str = TOML) -> str:
    assert text.count(old) >= 1
    return text.replace(old, new, 1)


def line_changed(number: int, new: str) -> str:
    """First record with one line replaced; the header is line 1."""
    lines = csv_text().splitlines()
    lines[number - 1] = new
    return "\n".join(lines) + "\n"


# --- reading ---------------------------------------------------------------------------------------


def check_hand_written(study: Study) -> None:
    assert study.name == "Hand-written"
    assert study.origin == "measured"
    first, second = study.records
    assert (first.frequency_hz, first.start_s, first.pose, first.label) == (5.0, 0.1, None, "01.csv")
    assert (first.torque_hold, first.torque_delay_s) == (True, 0.0005)
    assert (second.pose, second.label, second.torque_hold) == ("stretched", "elbow leads", False)
    assert second.torque_delay_s == 0.0005
    np.testing.assert_array_equal(study.inertia.M, [0.0025, 0.0010])
    np.testing.assert_array_equal(study.poses["stretched"].M, study.inertia.M)
    assert study.poses["stretched"].M2[0, 1] == 0.0021
    assert study.nominal is not None
    np.testing.assert_array_equal(study.nominal.K, [20.0, 3.5])
    # At t = 50 ms, a quarter of a 5 Hz period: joint 1 at its crest, joint 2 at zero.
    assert first.theta_rad[50, 0] == pytest.approx(0.1)
    assert first.tau_Nm[50, 1] == pytest.approx(1.0)
    assert first.theta_rad[50, 1] == pytest.approx(0.0, abs=1e-12)


def test_folder_zip_bytes_and_upload_read_the_same(tmp_path: Path) -> None:
    content = files()
    folder = written(tmp_path / "cell", content)
    archive = tmp_path / "cell.zip"
    archive.write_bytes(zipped(content, compression=zipfile.ZIP_DEFLATED))
    for source in (folder, str(folder), archive, archive.read_bytes(), io.BytesIO(archive.read_bytes())):
        check_hand_written(load_study(source))


def test_upload_stays_open_and_reads_twice() -> None:
    upload = io.BytesIO(zipped(files()))
    check_hand_written(load_study(upload))
    check_hand_written(load_study(upload))
    assert not upload.closed


def test_zip_of_the_folder_with_macos_files_is_read() -> None:
    content = {f"cell 1/{name}": data for name, data in files().items()}
    content |= {"__MACOSX/cell 1/._study.toml": b"\0", "cell 1/.DS_Store": b"\0", ".DS_Store": b"\0"}
    check_hand_written(load_study(zipped(content)))


def test_parquet_records_of_any_number_type() -> None:
    frame = pd.read_csv(io.StringIO(csv_text()))
    buffer = io.BytesIO()
    frame.assign(note="x", tau_m2_Nm=frame["tau_m2_Nm"].astype("float32")).to_parquet(buffer)
    content = files(toml=edited("01.csv", "01.parquet"), first=None)
    content["records/01.parquet"] = buffer.getvalue()
    record = load_study(zipped(content)).records[0]
    np.testing.assert_array_equal(record.theta_rad[:, 0], frame["theta_m1_rad"])
    np.testing.assert_array_equal(record.tau_Nm[:, 1], frame["tau_m2_Nm"].astype("float32"))


@pytest.mark.parametrize(
    "change",
    [
        lambda text: "\ufeff" + text,
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("\n", "\r"),
        lambda text: text.replace(",", " , "),
        lambda text: text.replace("\n", "\n\n"),
        lambda text: "\n\n" + text.rstrip("\n"),
        lambda text: text.replace(HEADER, ",".join(f'"{name}"' for name in HEADER.split(","))),
        lambda text: "\n".join(f"Zelle °C;7,{line}" for line in text.splitlines()),
    ],
    ids=["BOM", "CRLF", "CR", "blanks", "blank lines", "no end", "quotes", "extra column"],
)
def test_csv_dialects_that_mean_the_same(change) -> None:
    expected = load_study(zipped(files())).records[0]
    record = load_study(zipped(files(first=change(csv_text())))).records[0]
    assert record.theta_rad.tobytes() == expected.theta_rad.tobytes()
    assert record.time_s.tobytes() == expected.time_s.tobytes()


def test_column_order_does_not_matter() -> None:
    frame = pd.read_csv(io.StringIO(csv_text()))
    shuffled = frame[["tau_m2_Nm", "theta_m2_rad", "tau_m1_Nm", "time_s", "theta_m1_rad"]]
    record = load_study(zipped(files(first=shuffled.to_csv(index=False)))).records[0]
    np.testing.assert_array_equal(record.tau_Nm, frame[["tau_m1_Nm", "tau_m2_Nm"]])
    np.testing.assert_array_equal(record.theta_rad, frame[["theta_m1_rad", "theta_m2_rad"]])


def test_one_joint_may_give_plain_numbers() -> None:
    toml = (
        'format = 1\n[inertia]\nM = 0.002\nM2 = 0.004\n[[records]]\nfile = "a.csv"\nfrequency_hz = 5\n'
    )
    record = "time_s,theta_m1_rad,tau_m1_Nm\n" + "".join(f"{k / 100},{k % 3},1\n" for k in range(50))
    study = load_study(zipped({"study.toml": toml.encode(), "a.csv": record.encode()}))
    assert study.inertia.M2.shape == (1, 1)
    assert study.records[0].n == 1


# --- writing ---------------------------------------------------------------------------------------

channel_values = st.floats(-1e99, 1e99)
sensible = st.floats(1e-6, 1e6)
text = st.text(st.characters(exclude_categories=("Cs",)), max_size=12)


@st.composite
def inertias(draw: st.DrawFn, n: int) -> Inertia:
    diagonal = draw(st.lists(sensible, min_size=n, max_size=n))
    M2 = np.diag(diagonal)
    for i in range(n):
        for j in range(i):
            M2[i, j] = M2[j, i] = draw(st.floats(-0.3, 0.3)) * np.sqrt(diagonal[i] * diagonal[j])
    known = draw(st.sampled_from([None, None, 0.5 * M2, 1e-3 * M2, -M2]))
    return Inertia(M=draw(st.lists(sensible, min_size=n, max_size=n)), M2=M2, added=known)


deviations = st.one_of(st.sampled_from([0.0, 0.03, 0.05, np.inf]), st.floats(0, 1e300))


@st.composite
def studies(draw: st.DrawFn) -> Study:
    n = draw(st.integers(1, 3))
    poses = draw(st.dictionaries(text.filter(str.strip), inertias(n), max_size=2))
    inertia = draw(inertias(n))
    for base in draw(st.lists(st.sampled_from([inertia, *poses.values()]), max_size=2)):
        name = draw(text.filter(lambda name: name.strip() and name not in poses))
        payload = draw(st.floats(1e-3, 1)) * base.M2[0, 0]
        poses[name] = base.with_added(payload * np.ones((n, n)))
    records = []
    for _ in range(draw(st.integers(1, 3))):
        samples = draw(st.integers(4, 12))
        steps = draw(st.lists(st.floats(0.9, 1.1), min_size=samples, max_size=samples))
        time = draw(st.floats(-10, 10)) + draw(st.floats(1e-5, 10)) * np.cumsum(steps)
        values = draw(st.lists(channel_values, min_size=2 * n * samples, max_size=2 * n * samples))
        channels = np.reshape(values, (2, samples, n))
        interval = (time[-1] - time[0]) / (samples - 1)
        records.append(
            SineRecord(
                frequency_hz=draw(st.floats(1.01 / samples, 0.49)) / interval,
                time_s=time,
                theta_rad=channels[0],
                tau_Nm=channels[1],
                torque_hold=draw(st.booleans()),
                torque_delay_s=draw(st.sampled_from([0.0, -0.0, 0.00025, 1 / 3])),
                start_s=draw(st.sampled_from([None, float(time[0]), float(time[0]) - 1.0])),
                pose=draw(st.sampled_from([None, *poses])),
                label=draw(st.one_of(text, st.sampled_from(["01.csv", "02.parquet"]))),
            )
        )
    some = st.lists(sensible, min_size=n, max_size=n)
    nominal = Elasticity(K=draw(some), D=draw(some)) if draw(st.booleans()) else None
    origin = draw(st.sampled_from(["", "simulated", "measured"]))
    return Study(
        tuple(records), inertia, nominal, draw(text), origin, draw(text), poses,
        inertia_std=draw(deviations), torque_std=draw(st.one_of(st.none(), deviations)),
    )  # fmt: skip


@examples(60, derandomize=True)
@given(
    study=studies(),
    record_format=st.sampled_from(["csv", "parquet"]),
    suffix=st.sampled_from(["", ".zip"]),
)
def test_round_trip_is_exact(tmp_path_factory, study: Study, record_format, suffix: str) -> None:
    path = tmp_path_factory.mktemp("study") / f"cell{suffix}"
    save_study(study, path, record_format=record_format)
    assert study_digest(load_study(path)) == study_digest(study)


def a_study(scale: float = 1.0) -> Study:
    t = np.arange(400) * 0.001
    q = scale * np.column_stack([np.sin(2 * np.pi * 5 * t), np.cos(2 * np.pi * 5 * t)])
    inertia = Inertia([0.0025, 0.001], [[0.004104, 0.000395], [0.000395, 0.001889]])
    records = [SineRecord(5.0, t, q, 3 * q, torque_hold=True), SineRecord(7.0, t, q[:, ::-1], q)]
    return Study(tuple(records), inertia, name="Cell", origin="simulated")


def test_uncertainties_and_a_payload_are_read() -> None:
    toml = edited("[inertia]\n", "[inertia]\nstd = inf\n")
    toml = edited("[nominal]", "[torque]\nstd = 0.02\n[nominal]", toml)
    loaded = (
        "[poses.loaded]\nadded = [[0.0012, 0.0005], [0.0005, 0.0009]]\n"
        "[poses.further]\nbase = 'stretched'\nM = [0.003, 0.001]\nadded = [[0.002, 0], [0, 0]]\n"
        "[poses.both]\nM2 = [[0.009, 0], [0, 0.004]]\nadded = [[0.001, 0], [0, 0]]\n"
    )
    study = load_study(zipped(files(toml=edited("[[records]]", loaded + "[[records]]", toml))))
    assert (study.inertia_std, study.torque_std) == (np.inf, 0.02)
    payload = np.array([[0.0012, 0.0005], [0.0005, 0.0009]])
    pose = study.poses["loaded"]
    assert pose.added.tolist() == payload.tolist()
    assert pose.M2.tolist() == (study.inertia.M2 + payload).tolist()
    assert pose.M.tolist() == study.inertia.M.tolist()
    further = study.poses["further"]
    assert further.M.tolist() == [0.003, 0.001]
    assert further.M2.tolist() == (study.poses["stretched"].M2 + np.diag([0.002, 0])).tolist()
    assert study.poses["both"].M2.tolist() == [[0.009, 0], [0, 0.004]]  # the total
    assert study.poses["both"].added.tolist() == [[0.001, 0], [0, 0]]
    assert study_digest(load_study(pack_study(study))) == study_digest(study)


def test_additions_are_written_beside_the_total(tmp_path: Path) -> None:
    study = a_study()
    poses = {"loaded": study.inertia.with_added([[1e-3, 0], [0, 1e-4]])}
    save_study(replace(study, poses=poses, torque_std=0.0), tmp_path / "cell")
    written = tomllib.loads((tmp_path / "cell/study.toml").read_text(encoding="utf-8"))
    total = poses["loaded"].M2.tolist()
    assert written["poses"]["loaded"] == {"M2": total, "added": [[1e-3, 0], [0, 1e-4]]}
    assert written["torque"] == {"std": 0.0}
    assert "std" not in written["inertia"]  # 0.05 is what the reader assumes


def test_timing_that_differs_stands_with_each_record(tmp_path: Path) -> None:
    save_study(a_study(), tmp_path / "cell")
    toml = (tmp_path / "cell/study.toml").read_text(encoding="utf-8")
    assert "[timing]" not in toml
    assert toml.count("torque_hold") == 2


def test_equal_studies_give_equal_bytes(tmp_path: Path) -> None:
    save_study(a_study(), tmp_path / "a.zip")
    save_study(a_study(), tmp_path / "b.zip")
    assert (
        (tmp_path / "a.zip").read_bytes() == (tmp_path / "b.zip").read_bytes() == pack_study(a_study())
    )
    assert pack_study(a_study(2.0)) != pack_study(a_study())


@pytest.mark.parametrize("name", ["cell", "cell.zip"])
def test_nothing_is_overwritten_by_default(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    save_study(a_study(1.0), path)
    with pytest.raises(JointIdError, match=r"exists.*overwrite=True"):
        save_study(a_study(2.0), path)
    assert study_digest(load_study(path)) == study_digest(a_study(1.0))
    save_study(a_study(2.0), path, overwrite=True, record_format="parquet")
    assert study_digest(load_study(path)) == study_digest(a_study(2.0))
    assert os.listdir(tmp_path) == [name]


def test_a_folder_with_other_files_is_never_replaced(tmp_path: Path) -> None:
    path = tmp_path / "cell"
    save_study(a_study(), path)
    (path / "photo.jpg").write_bytes(b"x")
    with pytest.raises(JointIdError, match=r"photo\.jpg"):
        save_study(a_study(), path, overwrite=True)
    assert (path / "photo.jpg").exists()
    (tmp_path / "d.zip").mkdir()
    with pytest.raises(JointIdError, match="a folder"):
        save_study(a_study(), tmp_path / "d.zip", overwrite=True)


@pytest.mark.parametrize("name", ["cell", "cell.zip"])
def test_a_failed_save_keeps_the_previous_study(tmp_path: Path, name: str, monkeypatch) -> None:
    path = tmp_path / name
    save_study(a_study(1.0), path)
    before = load_study(path)

    def full(*_: object) -> bytes:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("jointid.files.study_saving.write_record_table", full)
    with pytest.raises(JointIdError, match="No space left"):
        save_study(a_study(2.0), path, overwrite=True)
    assert study_digest(load_study(path)) == study_digest(before)
    assert os.listdir(tmp_path) == [name]


def test_save_refuses_what_load_would_refuse(tmp_path: Path, monkeypatch) -> None:
    with pytest.raises(JointIdError, match="record_format"):
        save_study(a_study(), tmp_path / "a", record_format="xlsx")  # type: ignore[arg-type]
    with pytest.raises(JointIdError, match="is not a folder"):
        save_study(a_study(), tmp_path / "no" / "a")
    study = a_study()
    with pytest.raises(JointIdError, match="not a valid character"):
        save_study(Study(study.records, study.inertia, name="\ud800"), tmp_path / "a.zip")
    monkeypatch.setattr("jointid.files.study_saving.MAX_TOTAL_BYTES", 10_000)
    with pytest.raises(JointIdError, match="split it"):
        save_study(study, tmp_path / "a.zip")
    assert os.listdir(tmp_path) == []


# --- study.toml that cannot be used -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ("format = 1\n", "", ["study.toml", "format is missing", "format = 1"]),
        ("format = 1", "format = 2", ["format = 2", "reads format 1"]),
        ("format = 1", 'format = "1"', ["format", "whole number", "'1'"]),
        ("format = 1", "format = 0x" + "f" * 9000, ["format = a very large integer"]),
        ("format = 1", "format = 1\nnmae = 3", ['"nmae"', 'Did you mean "name"', "description"]),
        ("format = 1", "format = 1\nsurface = 3", ['"surface"', "Valid keys"]),
        ('name = "Hand-written"', "name = 3", ["study.toml", "name", "text", "3"]),
        ('"measured"', '"imagined"', ['"imagined"', "simulated"]),
        ("[inertia]\n", "[inertia]\nM3 = 1\n", ["[inertia]", '"M3"', 'Did you mean "M']),
        ("M = [0.0025, 0.0010]\n", "", ["[inertia]", "M is missing", "kg·m²"]),
        ("M = [0.0025, 0.0010]", 'M = [0.0025, "x"]', ["[inertia]", "M must be", "'x'"]),
        ("M = [0.0025, 0.0010]", "M = [0.0025, true]", ["[inertia]", "M must be", "True"]),
        ("M = [0.0025, 0.0010]", "M = [0.0025, nan]", ["[inertia]", "M holds nan"]),
        ("M = [0.0025, 0.0010]", "M = [0.0025, 1" + "0" * 400 + "]", ["M holds inf"]),
        ("M = [0.0025, 0.0010]", "M = [0.0025, -1]", ["[inertia]", "M2 = -1", "positive"]),
        ("M = [0.0025, 0.0010]", "M = []", ["[inertia]", "empty"]),
        ("[[0.004104, 0.000395], [0.000395, 0.001889]]", "[[1], [2, 3]]", ["M2", "equally long"]),
        ("[[0.004104, 0.000395], [0.000395, 0.001889]]", "[1, 2]", ["M2", "equally long"]),
        ("[[0.004104, 0.000395], [0.000395, 0.001889]]", "[[1, 0], [1, 2]]", ["[inertia]", "symmetric"]),
        ("K = [20.0, 3.5]", "K = [20.0]", ["[nominal]", "1 value"]),
        ("K = [20.0, 3.5]\nD = [0.10, 0.015]", "K = [20.0]\nD = [1]", ["nominal has 1 joint"]),
        ("[inertia]\n", "[inertia]\nstd = -0.1\n", ["study.toml, [inertia]", "std", "-0.1", "5 %"]),
        ("[inertia]\n", "[inertia]\nstd = nan\n", ["[inertia]", "std", "nan", "0.05 for 5 %"]),
        ("[inertia]\n", '[inertia]\nstd = "3 %"\n', ["[inertia]", "'3 %'", "inf for unknown"]),
        ("[inertia]\n", "[inertia]\nstd = true\n", ["[inertia]", "True", "standard deviation"]),
        ("[nominal]", "[torque]\n[nominal]", ["[torque]", "std is missing", "std = 0.02"]),
        ("[nominal]", "[torque]\nscale = 1\n[nominal]", ["[torque]", '"scale"', "Valid keys: std"]),
        ("[nominal]", "[torque]\nstd = -inf\n[nominal]", ["[torque]", "std", "-inf", "0 for exact"]),
        ("[nominal]", "torque = 3\n[nominal]", ["[inertia]", '"torque"']),
        ("[poses.stretched]", "[poses.stretched]\nstd = 0.1", ["[poses.stretched]", '"std"']),
        ("[poses.stretched]", "[poses.stretched]\nbase = 'a'", ["base", "in place of M2"]),
        (POSE, "added = [[1, 0], [2, 1]]", ["[poses.stretched]", "added must be symmetric"]),
        (POSE, "added = [[1]]", ["[poses.stretched]", "added has shape (1, 1)"]),
        (POSE, "added = [[-1, 0], [0, 0]]", ["[poses.stretched]", "M2 must be positive definite"]),
        (
            POSE,
            f"{POSE}\nadded = [[1, 0], [0, 1]]",
            ["M2 − added (M2 is the total) must be positive definite"],
        ),
        (POSE, "added = [[1, 0], [0, 1]]\nbase = 'no'", ['base = "no"', "Poses with M2: none"]),
        (
            POSE,
            "added = [[1, 0], [0, 1]]\nbase = 'ber'\n[poses.bar]\nM2 = 1",
            ["[poses.bar]", "M2 has shape"],
        ),
        (
            POSE,
            f"added = [[1, 0], [0, 1]]\nbase = 'ber'\n[poses.bar]\n{POSE}",
            ['base = "ber"', 'Did you mean "bar"'],
        ),
        ("torque_hold = true", 'torque_hold = "yes"', ["[timing]", "true or false", "'yes'"]),
        ("torque_hold = true", "torque_hold = 1", ["[timing]", "true or false"]),
        ("torque_delay_s", "torque_delay", ["[timing]", 'Did you mean "torque_delay_s"']),
        ("[poses.stretched]", "[poses.stretched]\nK = 3", ["[poses.stretched]", '"K"']),
        ("M2 = [[0.0081, 0.0021], [0.0021, 0.0019]]", "", ["[poses.stretched]", "M2 is missing"]),
        ("[poses.stretched]\nM2", "[poses]\nM2", ["poses", "M2"]),
        ('"stretched"', '"strecthed"', ["02.csv", '"strecthed"', 'Did you mean "stretched"']),
        ("frequency_hz = 5.0\n", "band_hz = [9, 2]\n", ["01.csv", "band_hz = [9, 2] Hz"]),
        ("frequency_hz = 5.0", 'frequency_hz = "5 Hz"', ["frequency_hz", "number", "'5 Hz'"]),
        ("frequency_hz = 5.0", "frequency_hz = -5.0", ["01.csv", "-5 Hz", "positive"]),
        ("frequency_hz = 5.0", "frequency_hz = 700", ["01.csv", "700 Hz", "half the sample rate"]),
        ("frequency_hz = 5.0", "frequency_hz = 1", ["01.csv", "less than one period", "1 Hz"]),
        ("start_s = 0.1", "start_s = 9", ["01.csv", "start_s = 9", "last sample"]),
        ("start_s = 0.1", "start_s = 2020-01-01", ["start_s", "number", "date"]),
        ("start_s = 0.1", "start = 0.1", ['"start"', 'Did you mean "start_s"']),
        (
            '"records/01.csv"',
            '"records/1.csv"',
            ["records/1.csv", "missing", 'Did you mean "records/01'],
        ),
        ('"records/01.csv"', '"records/02.csv"', ["number 2", "02.csv", "own file"]),
        ('"records/01.csv"', '"records/01.xlsx"', ["01.xlsx", "missing"]),
        ('"records/01.csv"', '"study.toml"', ["study.toml", ".csv or .parquet"]),
        ('"records/01.csv"', '"records"', ["records", "missing"]),
        ('"records/01.csv"', '""', ["names no file"]),
        ('"records/01.csv"', '"../secret.csv"', ["number 1", "..", "inside the study"]),
        ('"records/01.csv"', '"/etc/passwd"', ["number 1", "absolute"]),
        ('"records/01.csv"', "'C:\\x.csv'", ["number 1", "backslash"]),
        ('"records/01.csv"', '"C:x.csv"', ["number 1", "absolute"]),
        ('"records/01.csv"', '"a\\u0000.csv"', ["number 1", "control character"]),
        ("[[records]]", "[records]", ["not valid TOML"]),
        ("[inertia]", "[inertia", ["study.toml", "not valid TOML", "line 5"]),
        ("format = 1", "x = " + "[" * 9000, ["nested too deeply"]),
        ("format = 1", ".".join("a" * 9000) + " = 1", ["line 1", "32 dotted parts"]),
        ("format = 1", "format = " + "9" * 5000, ["not valid TOML"]),
    ],
)
def test_study_toml_errors_name_place_and_remedy(old: str, new: str, parts: list[str]) -> None:
    message = failure(zipped(files(toml=edited(old, new))))
    assert all(part in message for part in parts), message
    assert len(message) < 1500


def test_study_toml_without_records_or_of_another_kind() -> None:
    head = TOML[: TOML.index("[[records]]")]
    assert "records is missing" in failure(zipped(files(toml=head)))
    assert "no records" in failure(zipped(files(toml="records = []\n" + head)))
    assert "[[records]] number 1" in failure(zipped(files(toml="records = [3]\n" + head)))
    assert "tables [[records]]" in failure(zipped(files(toml=head + "[records]\nfile = 'x'\n")))
    assert "UTF-8" in failure(zipped(files(toml=TOML.replace("Hand", "Händ").encode("latin-1"))))
    assert "line 2" in failure(zipped(files(toml=TOML.replace("Hand", "Händ").encode("latin-1"))))
    assert "format is missing" in failure(zipped(files(toml=b"")))
    assert "limit" in failure(zipped(files(toml="#" * (checked_toml.MAX_TOML_BYTES + 1))))


# --- records that cannot be used ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("first", "parts"),
    [
        (b"", ["01.csv", "0 bytes"]),
        ("\n\r\n", ["01.csv", "blank lines"]),
        (HEADER, ["01.csv", "no rows"]),
        (HEADER + "\n\n\n", ["01.csv", "no rows"]),
        (
            csv_text().replace("tau_m2_Nm", "torque_2"),
            ["Torque of joint 2 is missing in records/01.csv: expected a column tau_m2_Nm.",
             "Columns found: time_s, theta_m1_rad, theta_m2_rad, tau_m1_Nm, torque_2."],
        ),
        (csv_text().replace("time_s", "t"), ["Time is missing in records/01.csv", "time_s"]),
        (csv_text().replace("time_s", "time_ms"), ["Convert time_ms", "divide by 1000"]),
        (csv_text().replace("theta_m1_rad", "theta_m1_deg"), ["Motor position of joint 1", "π/180"]),
        (csv_text().replace("tau_m1_Nm", "tau_m1_NM"), ['Did you mean "tau_m1_NM"']),
        (csv_text().replace("tau_m2_Nm", "tau_m1_Nm"), ["01.csv", "2 columns tau_m1_Nm"]),
        (csv_text().replace("tau_m2_Nm", "tau_m2_Nm,tau_m3_Nm"), ["tau_m3_Nm", "2 joints"]),
        (csv_text().replace(",", ";"), ["01.csv", "semicolons", "commas"]),
        (csv_text().replace(",", "\t"), ["01.csv", "tabs", "commas"]),
        (csv_text().encode("utf-16"), ["01.csv", "UTF-16"]),
        (csv_text().replace("tau_m2_Nm", "Größe").encode("latin-1"), ["01.csv", "not UTF-8", "0xF6"]),
        (b"\x89PNG\r\n\x1a\n\0\0\0", ["01.csv", "not UTF-8"]),
        (b"x" * 200_000, ["01.csv", "first line exceeds"]),
        (line_changed(7, "0.005,0,,0,0"), ["01.csv, line 7, column theta_m2_rad", "missing"]),
        (line_changed(7, "0.005,0,0,nan,0"), ["line 7, column tau_m1_Nm", '"nan"', "finite"]),
        (line_changed(7, "0.005,0,0,0,-inf"), ["line 7, column tau_m2_Nm", '"-inf"', "finite"]),
        (line_changed(7, "0.005,0,0,0,1e999"), ["line 7, column tau_m2_Nm", '"1e999"']),
        (line_changed(7, "0.005,0,0,0,err"), ["line 7, column tau_m2_Nm", '"err"', "not a number"]),
        (line_changed(7, '0.005,0,0,0,"1,5"'), ['"1,5"', "with a point"]),
        (line_changed(7, "0.005,0,0,0,1_0"), ["line 7", '"1_0"']),
        (line_changed(7, "0.005,0,0,0"), ["line 7", "4 values", "5 columns"]),
        (line_changed(7, "0.005;0;0;0;0"), ["line 7", "semicolons"]),
        (line_changed(7, "0.004,0,0,0,0"), ["line 7, column time_s", "0.004 s repeats", "line 6"]),
        (line_changed(7, "0.001,0,0,0,0"), ["line 7, column time_s", "goes back from 0.004 s"]),
        (line_changed(7, "\n\n0.005,0,0,0,x"), ["line 9, column tau_m2_Nm", '"x"']),
        (line_changed(7, "0.005,0,0,0,1" + "0" * 70_000), ["line 7", "longer than"]),
        (line_changed(501, "0.499,0,0,0,\x00"), ["line 501", "tau_m2_Nm"]),
        (line_changed(501, "0.499,0,0,0,x").encode() + b"\xff", ["line 501", "tau_m2_Nm"]),
        (csv_text(interval_s=1.0), ["01.csv", "milliseconds", "1000 samples per second", "2.495"]),
        (csv_text(interval_s=1000.0), ["01.csv", "5 Hz", "microseconds"]),
        (csv_text(rows=1), ["01.csv", "1 sample"]),
        (csv_text(rows=250), ["01.csv", "less than one period"]),
    ],
)  # fmt: skip
def test_record_errors_name_file_row_column_value_and_remedy(
    first: str | bytes, parts: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    message = failure(zipped(files(first=first)))
    assert all(part in message for part in parts), message
    assert len(message) < 600
    monkeypatch.setattr(csv_tables, "_BLOCK", 100)  # sound rows are skipped
    assert failure(zipped(files(first=first))) == message


def test_a_fault_far_down_is_found_soon() -> None:
    """Row by row, this took 10 s of CPU for a million rows, beside all other users."""
    rows = "".join(f"{k * 1e-3},1,2\n" for k in range(200_000))
    data = f"time_s,theta_m1_rad,tau_m1_Nm\n{rows}1e9,1,x\n".encode()
    names, body = csv_tables.read_header("01.csv", data)
    began = time.process_time()
    with pytest.raises(JointIdError, match="line 200002, column tau_m1_Nm"):
        csv_tables.read_columns("01.csv", data, names, body, [0, 1, 2])
    assert time.process_time() - began < 1


def test_milliseconds_are_not_guessed_when_seconds_are_possible() -> None:
    record = csv_text(frequency_hz=0.1, rows=200, interval_s=1.0)
    toml = edited("frequency_hz = 5.0", "frequency_hz = 0.1")
    assert load_study(zipped(files(toml=toml, first=record))).records[0].interval_s == 1.0


def parquet_study(frame: pd.DataFrame | bytes) -> bytes:
    content = files(toml=edited("01.csv", "01.parquet"), first=None)
    content["records/01.parquet"] = frame if isinstance(frame, bytes) else frame.to_parquet(None)
    return zipped(content)


def test_parquet_errors(monkeypatch) -> None:
    frame = pd.read_csv(io.StringIO(csv_text()))
    column = frame.columns.get_loc("tau_m1_Nm")
    for value in (np.nan, np.inf, None):
        broken = frame.copy()
        broken.iloc[41, column] = value
        message = failure(parquet_study(broken))
        assert "01.parquet, row 42, column tau_m1_Nm" in message
    message = failure(parquet_study(frame.drop(columns="tau_m2_Nm")))
    assert "Torque of joint 2 is missing in records/01.parquet" in message
    assert "expected numbers" in failure(parquet_study(frame.astype({"tau_m1_Nm": str})))
    assert "no rows" in failure(parquet_study(frame.iloc[:0]))
    assert "row 8, column time_s" in failure(parquet_study(frame.iloc[[0, 1, 2, 3, 4, 5, 6, 6, 7]]))
    assert "cannot be read as Parquet" in failure(parquet_study(b"PAR1 not really PAR1"))
    assert "cannot be read as Parquet" in failure(parquet_study(csv_text().encode()))
    monkeypatch.setattr(record_tables, "MAX_TOTAL_BYTES", 10_000)
    assert "more than the limit" in failure(parquet_study(frame))


# --- containers that cannot be trusted ----------------------------------------------------------------


def with_member(name: str, data: bytes = b"x", **attributes: int) -> bytes:
    buffer = io.BytesIO(zipped(files()))
    with zipfile.ZipFile(buffer, "a") as archive:
        member = zipfile.ZipInfo("placeholder")
        member.filename = name
        for key, value in attributes.items():
            setattr(member, key, value)
        archive.writestr(member, data)
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("archive", "part"),
    [
        (with_member("../evil.csv"), '".."'),
        (with_member("records/../../evil.csv"), '".."'),
        (with_member("/etc/evil.csv"), "absolute"),
        (with_member("C:/evil.csv"), "absolute"),
        (with_member("c:evil.csv"), "absolute"),
        (with_member("records\\03.csv"), "backslash"),
        (with_member("a\nb.csv"), "control character"),
        (with_member("link.csv", external_attr=(stat.S_IFLNK | 0o777) << 16), "is a link"),
        (with_member("x.csv", compress_type=zipfile.ZIP_LZMA), "ordinary (deflate)"),
        (with_member("records/./01.csv"), "lists records/01.csv twice"),
        (b"", "not a readable zip"),
        (b"PK\x03\x04 no more", "not a readable zip"),
        (csv_text().encode(), "not a readable zip"),
        (zipped({}), "study.toml is missing"),
        (zipped({"a/study.toml": b"", "b/study.toml": b""}), "a/study.toml, b/study.toml"),
        (zipped({"a/b/study.toml": b""}), "a/b/study.toml"),
        (zipped({"records/01.csv": b""}), "study.toml is missing"),
        (zipped({"Study.toml": b""}), 'Did you mean "Study.toml"'),
    ],
)
def test_unsafe_or_broken_archives_are_refused(archive: bytes, part: str) -> None:
    assert part in failure(archive)


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_member_listed_twice() -> None:
    assert "lists records/01.csv twice" in failure(with_member("records/01.csv"))


def test_encrypted_archive() -> None:
    archive = bytearray(zipped(files()))
    for signature, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        place = archive.find(signature)
        archive[place + offset] |= 1
    assert "password" in failure(bytes(archive))


def test_damaged_member_names_the_file() -> None:
    archive = zipped(files())
    damaged = archive.replace(b"0.1,", b"0.2,", 1)
    assert damaged != archive
    message = failure(damaged)
    assert "records/01.csv in the archive is damaged" in message


def test_bombs_are_stopped_by_directory_and_while_reading(monkeypatch) -> None:
    zeros = zipped(files(first=b"0" * (3 << 20)), compression=zipfile.ZIP_DEFLATED)
    assert len(zeros) < 100_000
    assert "times its packed size" in failure(zeros)
    monkeypatch.setattr(contained, "MAX_TOTAL_BYTES", 50_000)
    assert "would unpack to" in failure(zipped(files()))
    lying = bytearray(zipped(files(), compression=zipfile.ZIP_DEFLATED))
    place = -1
    while (place := lying.find(b"PK\x01\x02", place + 1)) >= 0:
        lying[place + 24 : place + 28] = struct.pack("<I", 10)  # claimed unpacked size
    assert "damaged" in failure(bytes(lying)) or "TOML" in failure(bytes(lying))
    monkeypatch.setattr(contained, "MAX_MEMBERS", 2)
    assert "more files than the limit of 2" in failure(zipped(files()))


def test_numbers_of_packed_records_are_bounded(monkeypatch) -> None:
    """A Parquet record of a few kilobytes holds any number of equal rows; an archive holds many."""
    import pyarrow as pa
    import pyarrow.parquet as pa_parquet

    def record(columns: dict[str, object]) -> bytes:
        buffer = io.BytesIO()
        pa_parquet.write_table(pa.table(columns), buffer)
        return buffer.getvalue()

    names = ["theta_m1_rad", "theta_m2_rad", "tau_m1_Nm", "tau_m2_Nm"]
    zeros = record(dict.fromkeys(["time_s", *names], np.zeros(1_000_000)))
    renamed = TOML.replace("01.csv", "01.parquet").replace("02.csv", "02.parquet")
    content = files(toml=renamed, first=None, second=None)
    assert "times its packed size" in failure(
        zipped(content | {f"records/0{k}.parquet": zeros for k in (1, 2)})
    )
    time = np.arange(2000) * 1e-3
    wave = np.tile(np.sin(np.arange(100) * 0.02 * np.pi), 20)
    fine = record({"time_s": time} | {name: (k + 1) * wave for k, name in enumerate(names)})
    both = content | {f"records/0{k}.parquet": fine for k in (1, 2)}
    assert len(load_study(zipped(both)).records) == 2
    monkeypatch.setattr(contained, "MAX_TOTAL_BYTES", 100_000)  # of numbers, 80 kB each
    message = failure(zipped(both))
    assert "records/02.parquet" in message
    assert "of all records together" in message


def test_folder_is_bounded_while_reading(tmp_path: Path, monkeypatch) -> None:
    folder = written(tmp_path, files())
    monkeypatch.setattr(contained, "MAX_TOTAL_BYTES", 50_000)
    assert "records/02.csv" in failure(folder)


def test_huge_directory_is_not_loaded() -> None:
    """A forged end record that claims a directory of 100 MB is refused before it is read."""

    class Counting(io.BytesIO):
        largest = 0

        def read(self, size: int | None = -1) -> bytes:
            data = super().read(size)
            Counting.largest = max(Counting.largest, len(data))
            return data

    directory = 100 << 20
    end = struct.pack("<4s4H2LH", b"PK\x05\x06", 0, 0, 65535, 65535, directory, 0, 0)
    assert "too large" in failure(Counting(bytes(directory) + end))
    assert Counting.largest <= 1 << 17


@pytest.mark.parametrize("size", [4 << 20, pytest.param(100 << 20, marks=pytest.mark.long)])
def test_megabytes_of_random_bytes_are_refused(size: int) -> None:
    garbage = np.random.default_rng(0).integers(0, 256, 1 << 20, dtype=np.uint8).tobytes() * (size >> 20)
    assert "not a readable zip" in failure(garbage)
    assert "01.csv" in failure(zipped(files(first=garbage)))
    digits = b"7" * size
    assert "first line exceeds" in failure(zipped(files(first=digits)))
    one_line = (HEADER + "\n").encode() + digits
    assert "line 2: longer than" in failure(zipped(files(first=one_line)))


def test_links_out_of_the_folder_are_refused(tmp_path: Path) -> None:
    outside = tmp_path / "outside.csv"
    outside.write_text(csv_text())
    folder = written(tmp_path / "cell", files())
    (folder / "records/01.csv").unlink()
    (folder / "records/01.csv").symlink_to(outside)
    assert "link that leaves cell" in failure(folder)
    (folder / "records/01.csv").unlink()
    (folder / "records/01.csv").symlink_to("02.csv")
    assert load_study(folder).records[0].n == 2
    (folder / "records/01.csv").unlink()
    (folder / "records/01.csv").symlink_to("01.csv")
    assert "01.csv" in failure(folder)
    (folder / "records/01.csv").unlink()
    os.mkfifo(folder / "records/01.csv")
    assert "is not a regular file" in failure(folder)
    (folder / "study.toml").unlink()
    (folder / "study.toml").symlink_to(outside)
    assert "link that leaves cell" in failure(folder)


def test_paths_without_a_study_are_refused(tmp_path: Path) -> None:
    assert "no such file or folder" in failure(tmp_path / "none")
    assert "study.toml is missing" in failure(written(tmp_path / "empty", {"a.txt": b""}))
    assert "Files found: a.txt" in failure(tmp_path / "empty")
    assert "not a readable zip" in failure(tmp_path / "empty/a.txt")
    assert "Give a study's folder" in failure("a\0b")
    assert "opened" in failure("x" * 5000)
    assert "not from int" in failure(3)
    assert "not from StringIO" in failure(io.StringIO("text"))


@pytest.mark.parametrize(
    "change",
    [
        lambda text: "# logged by hand\n#,;\n\n# 2026\n" + text,
        lambda text: "# exported\n# " + text,
        lambda text: "\ufeff#\n" + text,
        lambda text: ("# Gerät: Zürich\n" + text).encode("latin-1"),
    ],
)
def test_comments_above_the_column_names_are_skipped(change) -> None:
    check_hand_written(load_study(zipped(files(first=change(csv_text())))))


def test_lines_are_counted_from_the_top_below_comments() -> None:
    message = failure(zipped(files(first="# one\r\n# two\r\n" + line_changed(7, "0.005,0,0,0,x"))))
    assert "line 9, column tau_m2_Nm" in message
    assert "comments" in failure(zipped(files(first="# only\n# words\n")))


def test_format_1_may_be_written_as_a_decimal() -> None:
    check_hand_written(load_study(zipped(files(toml=edited("format = 1", "format = 1.0")))))
    assert "whole number" in failure(zipped(files(toml=edited("format = 1", "format = 1.5"))))


def test_the_path_of_study_toml_opens_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = written(tmp_path / "cell", files())
    check_hand_written(load_study(folder / "study.toml"))
    monkeypatch.chdir(folder)
    check_hand_written(load_study("study.toml"))
    assert "no such file or folder" in failure(tmp_path / "study.toml")


def test_only_files_of_no_record_are_suggested() -> None:
    content = files(toml=edited("records/02.csv", "records/03.csv"), second=None)
    content["records/030.csv"] = csv_text(10.0).encode()
    assert 'Did you mean "records/030.csv"' in failure(zipped(content))
    del content["records/030.csv"]
    message = failure(zipped(content))
    assert "records/03.csv is missing in the archive" in message
    assert "Did you mean" not in message


def test_messages_begin_with_a_capital_or_a_name() -> None:
    assert failure(b"no zip").startswith("The archive is not")
    assert failure(zipped({})).startswith("study.toml is missing in the archive")


def test_semicolons_are_sent_to_the_import_of_a_log() -> None:
    text = csv_text().replace(",", ";").replace(".", ",")
    assert "import it as a log" in failure(zipped(files(first=text)))


def test_an_error_carries_its_place_and_remedy() -> None:
    lines = csv_text(10.0).splitlines()
    lines[41] = "0.040,0,,0,0"
    with pytest.raises(JointIdError) as caught:
        load_study(zipped(files(second="\n".join(lines))))
    for error in (caught.value, pickle.loads(pickle.dumps(caught.value))):
        assert (error.file, error.line, error.column) == ("records/02.csv", 42, "theta_m2_rad")
        assert str(error).startswith("records/02.csv, line 42, column theta_m2_rad: ")
        assert str(error).endswith(f" {error.hint}")
    with pytest.raises(JointIdError) as caught:
        load_study(zipped(files(toml=edited("M = [", "M = [-"))))
    assert caught.value.file == "study.toml"


# --- what stays visible -------------------------------------------------------------------------------


@pytest.mark.parametrize("cells", ["0.400,0,nan,0,0", "0.400,0,err,0,0", "0.1,0,0,0,0"])
@pytest.mark.parametrize("comment", ["", "# exported\n# by hand\n"])
def test_the_lines_around_a_fault_are_shown(cells: str, comment: str) -> None:
    lines = csv_text(10.0, rows=3000).splitlines()
    lines[401] = cells
    content = zipped(files(second=comment + "\n".join(lines) + "\n"))
    with pytest.raises(JointIdError) as caught:
        load_study(content)
    shown = lines_around(content, caught.value).splitlines()
    assert [line for line in shown if "▶" in line] == [f"▶    {402 + comment.count(chr(10))}  {cells}"]
    assert shown[5].endswith(lines[400])


def test_no_lines_are_shown_without_a_place_in_a_text() -> None:
    assert lines_around(b"no zip", JointIdError("damaged", file="a.csv", line=3)) == ""
    first = lines_around(zipped(files()), JointIdError("no line", file="records/01.csv"))
    assert first.split()[:2] == ["1", "time_s,theta_m1_rad,theta_m2_rad,tau_m1_Nm,tau_m2_Nm"]
    assert lines_around(zipped(files()), JointIdError("x", file="r/1.parquet", line=1)) == ""


# --- mutations: nothing but JointIdError escapes -------------------------------------------------------


@st.composite
def mutations(draw: st.DrawFn, data: bytes) -> bytes:
    for _ in range(draw(st.integers(1, 3))):
        place = draw(st.integers(0, max(len(data) - 1, 0)))
        length = draw(st.sampled_from([0, 1, 1, 2, 8, 100, 10_000]))
        piece = draw(
            st.one_of(
                st.binary(max_size=6),
                st.sampled_from(
                    [b"nan", b",", b"\n", b'"', b"9" * 400, b"-", b"[", b"1e308", b"\xff\xff\xff\xff"]
                ),
                st.just(data[place : place + length]),
            )
        )
        data = data[:place] + piece + data[place + length :]
    return data


def survives(archive: bytes) -> None:
    try:
        load_study(archive)
    except JointIdError as refusal:
        lines_around(archive, refusal)


UNCERTAIN = edited("[inertia]\n", "[inertia]\nstd = 0.03\n")
UNCERTAIN = edited("[nominal]", "[torque]\nstd = inf\n[nominal]", UNCERTAIN)
UNCERTAIN = edited("[timing]", "[poses.loaded]\nadded = [[1, 0], [0, 1]]\n[timing]", UNCERTAIN)
SMALL = files(first=csv_text(5.0, rows=310), second=csv_text(10.0, rows=120))
PARQUET = pd.read_csv(io.StringIO(csv_text(rows=310))).to_parquet(None)


def test_the_study_before_mutation_is_valid() -> None:
    check_hand_written(load_study(zipped(SMALL)))
    assert load_study(parquet_study(PARQUET)).records[0].time_s.size == 310


@examples(150, derandomize=True)
@given(mutations(SMALL["study.toml"]) | mutations(UNCERTAIN.encode()))
def test_mutated_toml(data: bytes) -> None:
    survives(zipped(SMALL | {"study.toml": data}))


@examples(150, derandomize=True)
@given(mutations(SMALL["records/01.csv"]))
def test_mutated_csv(data: bytes) -> None:
    survives(zipped(SMALL | {"records/01.csv": data}))


@examples(150, derandomize=True)
@given(mutations(zipped(SMALL, compression=zipfile.ZIP_DEFLATED)))
def test_mutated_zip(data: bytes) -> None:
    survives(data)


@examples(150, derandomize=True)
@given(mutations(PARQUET))
def test_mutated_parquet(data: bytes) -> None:
    survives(parquet_study(data))
