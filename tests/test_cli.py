"""The command line: results for people and machines, exit codes, no traceback."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tomllib
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import jointid
from jointid import MotionRecord, Study, analyse, load_study, resonances, save_study
from jointid.cli import app
from jointid.cli.files import robot_from
from jointid.cli.options import gears
from jointid.errors import JointIdError
from jointid.exporting.identification import with_infinite_as
from jointid.files.application import __version__, sample_studies
from jointid.files.atomic_write import write_file
from jointid.files.digest import study_digest
from jointid.importing import mapping_from_json
from jointid.importing.study import study_name
from jointid.wording import with_error

run = CliRunner()
ROOT = Path(__file__).parents[1]


def ok(*arguments: object) -> str:
    result = run.invoke(app, [str(a) for a in arguments])
    assert result.exit_code == 0, result.stderr
    return result.stdout


def refused(code: int, *arguments: object) -> str:
    """The message of a command that must fail, with empty standard output."""
    result = run.invoke(app, [str(a) for a in arguments])
    assert result.exit_code == code, result.output
    assert result.stdout == ""
    assert "Traceback" not in result.stderr
    return str(result.stderr)


@pytest.fixture(scope="module")
def study(sample_folder: Path) -> Path:
    return sample_folder / "paper.zip"


@pytest.fixture(scope="module")
def one_joint(sample_folder: Path) -> Path:
    return sample_folder / "one_joint"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


# --- identify


def test_identify_prints_the_identification_as_json(study: Path) -> None:
    text = ok("identify", study, "--json")
    document = json.loads(text)
    fit = analyse(load_study(study)).fit
    assert document["K"] == fit.K.tolist()
    assert document["covariance"] == fit.covariance.tolist()
    assert {"level", "title", "detail", "remedy"} == set(document["findings"][0])
    squares = [np.square(part) for part in document["error_parts"].values()]
    assert np.sum(squares, axis=0) == pytest.approx(np.square(document["standard_error"]))
    assert document["standard_error"] == fit.standard_error.tolist()
    assert max(document["error_parts"]["prior"]) > 0
    assert document["answer"].endswith("if the torque scale is exact.")
    assert document["state"] == "usable"


def test_identify_prints_a_table_for_people(one_joint: Path) -> None:
    text = ok("identify", one_joint)
    fit = analyse(load_study(one_joint)).fit
    assert with_error(float(fit.K[0]), float(fit.standard_error[0])) in text
    assert "N·m·s/rad" in text
    assert "Good: " in text


def test_an_unusable_answer_begins_with_its_reason(here: Path) -> None:
    for asked in ([], ["--json"]):
        text = ok("identify", "exercise_1", *asked)
        assert text.index("look swapped") < text.index('"K"' if asked else "K and D are not shown")
        assert asked or " ± " not in text


def test_the_method_is_passed_on(one_joint: Path) -> None:
    document = json.loads(ok("identify", one_joint, "--method", "explicit", "--json"))
    assert document["obtained"]["method"] == "explicit"
    assert document["K"] == analyse(load_study(one_joint), method="explicit").fit.K.tolist()


# --- samples by name


def test_a_sample_is_a_study_by_its_name(here: Path) -> None:
    document = json.loads(ok("identify", "single_joint", "--json"))
    fit = analyse(load_study(ROOT / "sample_data" / "single_joint")).fit
    assert document["K"] == fit.K.tolist()
    assert json.loads(ok("identify", "single joint", "--json")) == document  # as the app shows it


def test_a_file_or_folder_has_priority_over_a_sample_of_the_same_name(
    here: Path, one_joint: Path
) -> None:
    shutil.copytree(one_joint, here / "single_joint")
    document = json.loads(ok("identify", "single_joint", "--json"))
    assert document["K"] == analyse(load_study(one_joint)).fit.K.tolist()


@pytest.mark.parametrize(
    "command", ["simulate", "export", "convert", "batch", "setpoints", "cut", "identify"]
)
def test_help_names_the_values_of_options(here: Path, command: str) -> None:
    text = ok(command, "--help")
    assert not re.search(r"<[\w\[\] ]+>", text)
    assert ("--output FILE" in text) == (command in ("convert", "export", "setpoints", "batch"))
    assert "--out " not in text
    assert ("--output FILE …" in text) == (command == "export")
    assert "[default: (" not in text


def test_the_samples_are_listed(here: Path) -> None:
    names = ["paper", "exercise_1", "exercise_2", "manutec_r3", "motions", "single_joint", "six_axes"]
    names += ["worn_cell"]
    assert list(sample_studies()) == names
    shown = re.sub(r"[\s│]+", " ", ok("identify", "--help"))
    assert f"sample: {', '.join(names)}" in shown
    said = refused(1, "identify", "worn_cel")
    assert f"or a sample: {', '.join(names)}. " in said
    assert 'Did you mean "worn_cell"?' in said


# --- what is wrong


def test_bad_input_is_code_1_with_one_message(here: Path, study: Path) -> None:
    assert "no such file or folder" in refused(1, "identify", here / "none.zip")
    (here / "broken.zip").write_bytes(study.read_bytes()[:1000])
    message = refused(1, "identify", here / "broken.zip")
    assert message.startswith("Error: ")
    assert len(message.splitlines()) == 1


def test_a_batch_with_a_missing_study_is_refused(here: Path, study: Path) -> None:
    said = refused(1, "batch", study, here / "none.zip", "-o", "r.parquet")
    assert said == f"Error: {here / 'none.zip'}: no such file or folder. Check the path.\n"
    assert not [*here.glob("r.parquet*")]


def test_an_error_names_options_and_not_parameters(study: Path) -> None:
    assert refused(1, "identify", study, "--inertia-std", "-1").startswith("Error: --inertia-std = -1")
    assert "--zones-mm -1: expected" in refused(2, "cut", "--zones-mm", "-1")
    assert "A corner zone of 20 mm does not fit" in refused(1, "cut", "--zones-mm", "20")


@pytest.mark.parametrize(
    "arguments",
    [
        ["identify"],
        ["identify", "x.zip", "--method", "magic"],
        ["identify", "x.zip", "--nonsense"],
        ["frobnicate"],
        ["report", "x.zip", "-o", "x.docx"],
        ["export", "x.zip", "-o", "x.csv"],
        ["export", "single_joint", "-o", "x.urdf"],
        ["cut", "x.zip", "--zones-mm", "a,b"],
        ["cut", "--drive", "hydraulic"],
        ["convert", "x.csv"],
        ["convert", "x.csv", "--mapping", "m.json", "--guess", "m.json"],
        ["simulate", "x.zip", "--count", "0"],
        ["simulate", "x.zip", "--encoder-counts", "-5"],
        *([command, ""] for command in ("identify", "cut", "report", "plan", "simulate")),
        ["export", "", "-o", "r.json"],
        ["convert", "", "--guess", "m.json"],
        ["batch", "", "-o", "r.parquet"],
        ["batch", "x.zip"],
        *(
            ["batch", "x.zip", "-o", "r.parquet", *wrong]
            for wrong in (
                ["--method", "magic"],
                ["--workers", "0"],
                ["--memory", "0"],
                ["--timeout", "-1"],
                ["--workers", "1", "--scheduler", "tcp://x:1"],
            )
        ),
    ],
)
def test_a_wrong_command_is_code_2(here: Path, arguments: list[str]) -> None:
    refused(2, *arguments)


@pytest.mark.parametrize(
    ("code", "arguments"),
    [
        (1, ["identify", "none.zip"]),
        (1, ["simulate", "x.zip", "--motion", "sweep", "--count", "4"]),
        (1, ["simulate", "x.zip", "--records", "3"]),
        (1, ["export", "none.zip", "-o", "r.json"]),
        (1, ["batch", "none", "-o", "no folder/r.parquet"]),
        (1, ["identify", "n\udcffne ×.zip"]),
        (2, ["identify", "x.zip", "--method", "magic"]),
        (2, ["identify", "x.zip", "--nonsense"]),
        (2, ["identify"]),
        (2, ["frobnicate"]),
        (2, ["export", "x.zip", "-o", "x.csv"]),
    ],
)
def test_an_error_is_json_too_when_asked(here: Path, code: int, arguments: list[str]) -> None:
    silent = run.invoke(app, arguments)
    result = run.invoke(app, [*arguments, "--json"])
    assert result.exit_code == silent.exit_code == code
    assert silent.stdout == ""
    assert result.stderr == silent.stderr
    assert result.stdout.isascii()
    document = json.loads(result.stdout)
    assert list(document) == ["error"]
    said = "".join(silent.stderr.encode("utf-8", "backslashreplace").decode().split())
    assert "".join(document["error"].split()) in said


def test_an_internal_error_is_reported_as_such(study: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object, **__: object) -> None:
        raise ZeroDivisionError("somewhere deep")

    monkeypatch.delenv("JOINTID_DEBUG", raising=False)
    monkeypatch.setattr("jointid.cli.files.analyse", fails)
    message = refused(1, "identify", study)
    assert "Internal error, ZeroDivisionError (somewhere deep" in message


def test_identify_takes_other_uncertainties_than_the_studys(study: Path) -> None:
    def errors(*options: str) -> np.ndarray:
        return np.array(json.loads(ok("identify", study, "--json", *options))["standard_error"])

    as_stated, exact = errors(), errors("--inertia-std", "0", "--torque-std", "0")
    assert np.all(exact <= as_stated)
    assert errors("--inertia-std", "0.05") == pytest.approx(as_stated)  # what the study assumes
    loose = errors("--inertia-std", "0.05", "--torque-std", "0.1")
    assert np.all(loose > 2 * as_stated)
    assert "--inertia-std = nan: expected" in refused(1, "identify", study, "--inertia-std", "nan")


# --- simulate, cut, plan


def test_a_simulated_study_has_the_errors_that_were_asked_for(here: Path) -> None:
    made = ["simulate", "s.zip", "--count", "4", "--periods", "6", "--inertia-error", "0.1"]
    made += ["--torque-gain", "1.07,0.95", "--added", "0.0012,0.0005;0.0005,0.0009"]
    ok(*made, "--inertia-std", "inf", "--torque-std", "inf")
    study = load_study(here / "s.zip")
    assert (study.inertia_std, study.torque_std) == (np.inf, np.inf)
    assert study.poses["loaded"].added.tolist() == [[0.0012, 0.0005], [0.0005, 0.0009]]
    assert len(study.records) == 16
    found = json.loads(ok("identify", "s.zip", "--json"))
    np.testing.assert_allclose(found["K"], [43, 7.5], rtol=0.02)
    assert found["standard_error"][0] < 1
    assert "0 ≤ relative error < 1" in refused(1, *made, "--overwrite", "--inertia-error", "5")
    assert "expected numbers" in refused(2, *made, "--overwrite", "--added", "heavy")


def test_a_simulated_study_gives_its_parameters_back(here: Path) -> None:
    made = ["simulate", "s.zip", "--count", "6", "--periods", "8", "--K", "30,9", "--D", "0.05,0.02"]
    made += ["--seed", "7", "--nominal-K", "20,5", "--nominal-D", "0.05,0.02", "--json"]
    document = json.loads(ok(*made))
    assert document["joints"] == 2
    assert len(document["records"]) == 12
    study = load_study(here / "s.zip")
    assert document["digest"] == study_digest(study)
    found = json.loads(ok("identify", "s.zip", "--json"))
    errors = found["standard_error"]
    for value, true, error in zip([*found["K"], *found["D"]], [30, 9, 0.05, 0.02], errors, strict=True):
        assert abs(value - true) < 5 * error + 1e-4 * true
    assert "--overwrite" in refused(1, *made[:-1])
    assert json.loads(ok(*made, "--overwrite"))["digest"] == document["digest"]


def test_simulated_gears_have_their_laws(here: Path) -> None:
    made = ["simulate", "s.zip", "--count", "6", "--periods", "5", "--gear", "1: cubic=9000"]
    ok(*made, "--gear", "2:backlash=0.004")
    kinds = ("json", "gears.csv", "gears.txt", "torsion.csv", "st", "c", "m", "py")
    ok("export", "s.zip", *(part for kind in kinds for part in ("-o", f"s.{kind}")))
    laws = json.loads((here / "s.json").read_text("utf-8"))["gears"]
    assert laws["kind"] == ["hardening", "backlash"]
    assert "double gear2(" in (here / "s.gears.txt").read_text("utf-8")
    assert "torque_m2_Nm" in (here / "s.gears.csv").read_text("utf-8")
    assert "law_Nm" in (here / "s.torsion.csv").read_text("utf-8")
    assert "JointStiffness : ARRAY [1..2] OF LREAL := [" in (here / "s.st").read_text("utf-8")
    assert "static const double D[2] = {" in (here / "s.c").read_text("utf-8")
    np.testing.assert_allclose(laws["cubic"], [9000, 0], rtol=0.02)
    np.testing.assert_allclose(laws["backlash_rad"], [0, 0.004], rtol=0.02)


def test_wrong_laws_of_gears_are_refused(here: Path) -> None:
    made = ["simulate", "s.zip", "--count", "6", "--periods", "5", "--gear"]
    assert "joints 1 to 2" in refused(2, *made, "3: cubic=1")
    assert "presliding" in refused(2, *made, "loss=0.1")
    assert "not a number" in refused(2, *made, "cubic=hard")
    assert "presliding_rad" in refused(1, *made, "hysteresis=0.1")


@pytest.mark.parametrize("joints", [1, 2])
def test_motions_of_simulated_gears_have_their_laws(here: Path, joints: int) -> None:
    made = ["simulate", "s.zip", "--motion", "sweep", "--duration-s", "4", "--records", "1"]
    if joints == 1:
        (here / "one.toml").write_text("M = [0.0025]\nM2 = [[0.004104]]\n", "utf-8")
        made += ["--inertia", "one.toml", "--K", "43", "--D", "0.1"]
    ok(*made, "--gear", "1: cubic=9000")
    (record,) = load_study(here / "s.zip").records
    assert isinstance(record, MotionRecord)
    fit = analyse(load_study(here / "s.zip")).fit
    assert [gear.kind for gear in fit.gears] == ["hardening", "linear"][:joints]
    assert fit.gears[0].cubic == pytest.approx(9000, rel=0.03)
    np.testing.assert_allclose(fit.K, [43, 7.5][:joints], rtol=0.005)


def test_gears_of_all_joints_and_of_one() -> None:
    found = gears(["cubic=5, K2=3,K3=4,T1=1,T2=2", " 2 : cubic = 7"], 2)
    assert [gear.cubic for gear in found] == [5, 7]
    assert {(gear.K2, gear.K3, gear.T1_Nm, gear.T2_Nm) for gear in found} == {(3, 4, 1, 2)}


def test_a_user_defined_robot_is_simulated(here: Path) -> None:
    (here / "robot.toml").write_text("M = [0.003]\nM2 = [[0.005]]\n", "utf-8")
    ok("simulate", "s", "--inertia", "robot.toml", "--K", "30", "--D", "0.05", "--count", "3")
    study = load_study(here / "s")
    assert study.inertia.n == 1
    assert study.origin == "simulated"
    assert robot_from(here / "s").inertia.M2.tolist() == [[0.005]]
    assert resonances(study.inertia, analyse(study).fit.elasticity)[0] == pytest.approx(20.1, abs=0.1)


def test_cut_of_a_study(study: Path, here: Path) -> None:
    document = json.loads(ok("cut", study, "--zones-mm", "5", "--svg", "cut.svg", "--json"))
    assert document["rule"] == "direct"
    assert document["assumption"] == "study"
    (row,) = document["cuts"]
    assert row["before_mm"] > 10 * row["after_mm"] > 0
    assert row["before_tracking_mm"] >= row["before_mm"]
    assert (here / "cut.svg").read_text("utf-8").startswith("<svg")


def test_cut_says_what_its_rule_means(study: Path, one_joint: Path) -> None:
    said = {
        "The inertias of this study are those of the example arm": ["cut", study],
        "K and D of this study apply unchanged, but": ["cut", study, "--drive", "serial"],
        "A cut in the plane needs a study of two joints": ["cut", one_joint],
    }
    for text, command in said.items():
        assert text in ok(*command, "--zones-mm", "5"), text


def test_cut_of_six_axes_uses_the_robot_of_the_study() -> None:
    document = json.loads(ok("cut", "six_axes", "--zones-mm", "10", "--json"))
    assert document["rule"] == "own robot"
    (row,) = document["cuts"]
    assert row["sag_mm"] > row["gravity_mm"] > 0
    assert row["rigid_mm"] > row["assumed_mm"] > 20 * row["identified_mm"] > 0


def test_cut_without_a_study_shows_the_papers_values() -> None:
    document = json.loads(ok("cut", "--zones-mm", "10", "--assumed", "stiff", "--json"))
    assert document["K"] == [43.0, 7.5]
    assert document["assumed"]["K"] == [129.0, 22.5]
    assert document["cuts"][0]["before_mm"] == pytest.approx(1.96, rel=0.15)
    assert "10 mm" in ok("cut", "--zones-mm", "10")


def test_plan_predicts_smaller_errors(study: Path) -> None:
    document = json.loads(ok("plan", study, "--count", "2", "--json"))
    today, after = document["relative_error_today"], document["records"][-1]["relative_error_after"]
    assert max(after) < max(today)
    assert len(document["records"][0]["torque_Nm"]) == 2
    assert document["limit"] == ""
    assert "record 1" in ok("plan", study, "--count", "1")


def test_plan_predicts_no_errors_for_an_answer_that_is_not_usable(here: Path) -> None:
    shown = ok("plan", "exercise_1", "--count", "1")
    assert "K and D that are not usable" in shown
    assert "record 1" in shown
    assert "%" not in shown


# --- report, export, convert


def test_report_is_written_as_asked(one_joint: Path, here: Path) -> None:
    assert json.loads(ok("report", one_joint, "-o", "a.html", "-o", "a.pdf", "--json"))["written"] == [
        "a.html",
        "a.pdf",
    ]
    assert (here / "a.pdf").read_bytes().startswith(b"%PDF")
    ok("report", one_joint, "--no-cut")
    assert "--overwrite" in refused(1, "report", one_joint, "--no-cut")
    assert (here / "one_joint-report.html").read_text("utf-8") == (here / "a.html").read_text("utf-8")
    assert sorted(path.name for path in here.iterdir()) == ["a.html", "a.pdf", "one_joint-report.html"]


def test_export_writes_every_kind(study: Path, here: Path) -> None:
    kinds = ["json", "toml", "mat", "phasors.csv", "H.csv", "zip", "xml", "urdf", "sdf"]
    files = [f"r.{kind}" for kind in kinds]
    arguments = [part for file in files for part in ("-o", file)]
    ok("export", study, *arguments, "--gear-ratio", "100,90")
    analysis = analyse(load_study(study))
    for name, read in (("r.json", json.loads), ("r.toml", tomllib.loads)):
        assert read((here / name).read_text("utf-8"))["K"] == analysis.fit.K.tolist()
    assert study_digest(load_study(here / "r.zip")) == study_digest(analysis.study)
    assert repr(float(100.0**2 * analysis.fit.K[0])) in (here / "r.xml").read_text("utf-8")
    assert sorted(path.name for path in here.iterdir()) == sorted(files)
    assert "is not a folder" in refused(1, "export", study, "-o", "none/r.json")


def test_export_writes_no_table_without_rows(here: Path) -> None:
    motions = ROOT / "sample_data/motions.zip"
    result = run.invoke(app, ["export", str(motions), "-o", "r.phasors.csv", "-o", "r.json", "--json"])
    assert result.exit_code == 0
    assert result.stderr == "r.phasors.csv is not written: the study has no sine records.\n"
    assert json.loads(result.stdout) == {"written": ["r.json"]}
    assert [path.name for path in here.iterdir()] == ["r.json"]


def test_export_says_that_the_answer_is_a_problem(studies: dict[int, Study], here: Path) -> None:
    good = studies[1]
    reversed_torque = [replace(record, tau_Nm=-record.tau_Nm) for record in good.records]
    save_study(replace(good, records=reversed_torque), "wrong.zip")
    problems = [f for f in analyse(load_study("wrong.zip")).findings if f.level == "problem"]
    result = run.invoke(app, ["export", "wrong.zip", "-o", "r.json", "-o", "r.toml", "--json"])
    assert result.exit_code == 0
    assert json.loads(result.stdout) == {"written": ["r.json", "r.toml"]}
    (said,) = result.stderr.splitlines()
    assert said.startswith(f"Not usable: {problems[0].title}. ")
    save_study(good, "good.zip")
    assert run.invoke(app, ["export", "good.zip", "-o", "r.json", "--overwrite"]).stderr == ""


def test_one_study_of_a_batch_is_counted_as_one(one_joint: Path, here: Path) -> None:
    assert ok("batch", one_joint, "-o", "r.parquet", "--workers", 1).startswith(
        f"{here / 'r.parquet'}: 1 study, 1 of them with an answer\n"
    )


def log_text(study: Study) -> str:
    """All records of a study as one log with rests, time in ms, angle in degrees at the joint."""
    lines, start = ["time [ms];position joint 1 [deg];torque motor 1 [Nm]"], 0.0
    for record in study.records:
        rest = np.arange(0.0, 0.4, record.interval_s)
        for time, theta, tau in (
            (record.time_s, record.theta_rad[:, 0], record.tau_Nm[:, 0]),
            (rest, np.zeros(rest.size), np.zeros(rest.size)),
        ):
            rows = zip(1e3 * (start + time), np.degrees(theta) / 50, tau, strict=True)
            lines += [f"{t:.3f};{q:.12f};{u:.9f}" for t, q, u in rows]
            start += float(time[-1]) + record.interval_s
    return "\n".join(lines)


def test_a_missing_file_of_inertias_is_shown_as_it_should_be(here: Path) -> None:
    with pytest.raises(JointIdError, match=r"robot\.toml: no such file") as error:
        robot_from(here / "robot.toml")
    (here / "robot.toml").write_text(str(error.value).partition("\n\n")[2], "utf-8")
    robot = robot_from(here / "robot.toml")
    assert robot.inertia.n == 2
    assert robot.inertia_std == np.inf


def test_a_log_is_converted_by_its_mapping(studies: dict[int, Study], here: Path) -> None:
    pytest.importorskip("jointid.importing")
    known = studies[1]
    (here / "log.csv").write_text(log_text(known), "utf-8")
    text = ok("convert", "log.csv", "--guess", "mapping.json")
    assert "gear ratio of joint 1" in text
    mapping: dict[str, Any] = json.loads((here / "mapping.json").read_text("utf-8"))
    assert {"direction of position of joint 1", "torque hold"} < set(mapping["assumed"])
    listed = {line.strip().partition("  ")[0] for line in text.splitlines() if "check" in line}
    assert listed >= set(mapping["assumed"])
    mapping["joints"][0]["gear_ratio"] = 50.0
    mapping["joints"][0]["position"]["side"] = "joint"
    mapping["joints"][0]["torque"]["side"] = "motor"
    mapping["torque_hold"] = True
    (here / "mapping.json").write_text(json.dumps(mapping), "utf-8")
    (here / "robot.toml").write_text(
        f"[inertia]\nM = {known.inertia.M.tolist()}\nM2 = {known.inertia.M2.tolist()}\n", "utf-8"
    )
    given = ["--mapping", "mapping.json", "--inertia", "robot.toml", "-o", "new.zip"]
    document = json.loads(ok("convert", "log.csv", *given, "--json"))
    found = [record["frequency_hz"] for record in document["records"]]
    long = [r.frequency_hz for r in known.records if r.periods > 5]  # a shorter run is no segment
    np.testing.assert_allclose(found, long, rtol=1e-4)
    K = json.loads(ok("identify", "new.zip", "--json"))["K"]
    np.testing.assert_allclose(K, analyse(known).fit.K, rtol=2e-3)
    (here / "again.toml").write_text((here / "robot.toml").read_text("utf-8"), "utf-8")
    with (here / "robot.toml").open("a", encoding="utf-8") as toml:
        toml.write("std = 0.1\n[torque]\nstd = 0.04\n")
    stated = ["convert", "log.csv", *given, "--overwrite", "--json"]
    assert "torque scale is not stated" not in run.invoke(app, stated).stderr
    study = load_study(here / "new.zip")
    assert (study.inertia_std, study.torque_std) == (0.1, 0.04)
    ok(*stated, "--inertia-std", "inf", "--torque-std", "0")
    study = load_study(here / "new.zip")
    assert (study.inertia_std, study.torque_std) == (np.inf, 0.0)
    assert "torque scale is not stated" in run.invoke(app, [*stated, "--inertia", "again.toml"]).stderr
    assert "--torque-std = -1.0: expected" in refused(1, *stated[:-1], "--torque-std", "-1")


def test_runs_are_listed_corrected_and_used(studies: dict[int, Study], here: Path) -> None:
    (here / "log.csv").write_text(log_text(studies[1]), "utf-8")
    inertia = studies[1].inertia
    (here / "robot.toml").write_text(f"M = {inertia.M.tolist()}\nM2 = {inertia.M2.tolist()}\n", "utf-8")
    ok("convert", "log.csv", "--guess", "m.json")
    given = ["convert", "log.csv", "--mapping", "m.json"]
    made = [*given, "--inertia", "robot.toml", "--overwrite", "-o", "new.zip"]
    assert "sine runs" in ok(*given, "--list-runs", "runs.json")
    ok(*made)
    found = load_study(here / "new.zip")
    ok(*made, "--runs", "runs.json")
    assert study_digest(load_study(here / "new.zip")) == study_digest(found)
    runs = json.loads((here / "runs.json").read_text("utf-8"))
    first, second, third, fourth, *_ = runs["runs"]
    first["start_s"] += 1.0
    second["frequency_hz"] *= 1.01
    runs["runs"] = [first, second, {**third, "frequency_hz": None}, {**fourth, "log": None}]
    (here / "runs.json").write_text(json.dumps(runs), "utf-8")
    assert "Run 4 of the list: log = None; expected one of log.csv" in refused(
        1, *made, "--runs", "runs.json"
    )
    del runs["runs"][3]
    (here / "runs.json").write_text(json.dumps(runs), "utf-8")
    document = json.loads(ok(*made, "--runs", "runs.json", "--json"))
    assert document["read_as"][0].startswith("log.csv: read as a table of text, ")
    records = load_study(here / "new.zip").records
    assert records[0].time_s[0] == pytest.approx(found.records[0].time_s[0] + 1.0)
    assert [r.frequency_hz for r in records] == pytest.approx(
        [first["frequency_hz"], second["frequency_hz"], third["frequency_hz"]], rel=1e-5
    )
    assert "leave out --runs" in refused(2, *given, "--list-runs", "r.json", "--runs", "runs.json")
    assert "need a checked mapping" in refused(
        2, "convert", "log.csv", "--guess", "g.json", "--runs", "runs.json"
    )


def test_a_log_without_a_sine_is_distinguished_from_one_with_a_sine(
    studies: dict[int, Study], here: Path
) -> None:
    (here / "log.csv").write_text(log_text(studies[1]), "utf-8")
    noise = np.random.default_rng(3).standard_normal((2000, 2))
    rows = [f"{t:d};{q:.6f};{u:.6f}" for t, (q, u) in enumerate(noise)]
    head = "time [ms];position joint 1 [deg];torque motor 1 [Nm]"
    (here / "noise.csv").write_text("\n".join([head, *rows]), "utf-8")
    (here / "robot.toml").write_text("M = [0.003]\nM2 = [[0.005]]\n", "utf-8")
    ok("convert", "log.csv", "--guess", "mapping.json")
    given = ["--mapping", "mapping.json", "--inertia", "robot.toml", "-o", "new.zip"]
    message = refused(1, "convert", "noise.csv", *given)
    assert "noise.csv: no steady sine run in 2.00 s of log." in message
    assert "page Import a log" in message
    assert not (here / "new.zip").exists()
    document = json.loads(ok("convert", "noise.csv", "log.csv", *given, "--json"))
    assert document["notes"] == ["noise.csv: no steady sine run in 2.00 s of log."]
    assert all("log.csv" in record["label"] for record in document["records"])


def test_gear_ratios_and_inertias_of_a_log_come_from_a_robot_model(here: Path) -> None:
    """It took an inertia file with the model's name and the angles."""
    given = load_study(sample_studies()["six_axes"])
    model = given.robot_model
    assert model is not None
    record = given.records[0]
    angles = np.rad2deg(record.theta_rad / model.gear_ratio)
    names = [f"axis{j}_{what}" for what in ("position_deg", "motor_torque_Nm") for j in range(1, 7)]
    rows = np.column_stack([record.time_s, angles, record.tau_Nm])
    np.savetxt("log.csv", rows, "%.12g", ",", header=",".join(["time_s", *names]), comments="")
    Path(model.source[0]).write_bytes(model.source[1])
    ok("convert", "log.csv", "--guess", "m.json")
    shown = ok("convert", "log.csv", "--guess", "g.json", "--robot-model", model.source[0], "--json")
    proposed, entries = mapping_from_json(Path("g.json").read_bytes()), json.loads(shown)["reasons"]
    assert [joint.gear_ratio for joint in proposed.joints] == model.gear_ratio.tolist()
    assert sum(each["sure"] for each in entries if each["what"].startswith("gear ratio")) == 6
    command = ["convert", "log.csv", "--mapping", "m.json", "--robot-model", model.source[0]]
    ok(*command, "-o", "new.zip")
    found = load_study("new.zip")
    assert found.robot_model is not None
    np.testing.assert_array_equal(found.gear_ratios, model.gear_ratio)
    np.testing.assert_allclose(found.inertia.M, model.rotor_inertia)
    mean = np.deg2rad(angles).mean(axis=0)
    np.testing.assert_allclose(found.inertia.M2, model.inertia(mean).M2, rtol=0.05, atol=1e-7)
    ok(*command, "--angles-deg", "0,-60,100,20,40,10", "-o", "other.zip")
    at = np.deg2rad([0, -60, 100, 20, 40, 10])
    np.testing.assert_allclose(load_study("other.zip").inertia.M2, model.inertia(at).M2)
    assert "--robot-model" in refused(2, "convert", "log.csv", "--mapping", "m.json", "-o", "x.zip")


# --- what exists is not lost


def test_an_input_file_is_never_overwritten(study: Path, here: Path) -> None:
    copy, log = here / "one.zip", here / "log.csv"
    copy.write_bytes(study.read_bytes())
    log.write_text("time [s],position [rad],torque [Nm]\n" + "0,0,0\n" * 50, "utf-8")
    (here / "log.json").write_text(log.read_text("utf-8"), "utf-8")
    (here / "link.zip").symlink_to(copy)
    with zipfile.ZipFile(study) as archive:
        archive.extractall(here / "folder")
    before = {path: path.read_bytes() for path in here.rglob("*") if path.is_file()}
    read = "is the input of this command"
    assert "ends in .json" in refused(2, "convert", log, "--guess", log)
    assert read in refused(1, "convert", "log.json", "--guess", "log.json", "--overwrite")
    given = ("--mapping", "log.json", "--inertia", "one.zip", "--overwrite")
    assert read in refused(1, "export", "one.zip", "-o", "one.zip", "--overwrite")
    assert read in refused(1, "export", "link.zip", "-o", "one.zip", "--overwrite")
    assert read in refused(1, "export", "folder", "-o", "folder/study.toml", "--overwrite")
    assert read in refused(1, "simulate", "one.zip", "--inertia", "one.zip", "--overwrite")
    assert read in refused(1, "simulate", "folder", "--inertia", "folder/study.toml", "--overwrite")
    assert read in refused(1, "convert", log, *given, "-o", "one.zip")
    assert before == {path: path.read_bytes() for path in here.rglob("*") if path.is_file()}


def test_a_study_is_replaced_only_when_asked(study: Path, one_joint: Path, here: Path) -> None:
    (here / "victim.zip").write_bytes(b"another study")
    (here / "victim.csv").write_bytes(b"a log")
    (here / "cell").mkdir()
    (here / "cell" / "study.toml").write_bytes(b"a third")
    assert "--overwrite" in refused(1, "export", study, "-o", "victim.zip")
    assert "--overwrite" in refused(1, "export", study, "-o", "new.json", "-o", "cell/study.toml")
    assert "ends in .svg" in refused(2, "cut", study, "--svg", "victim.zip")
    assert "ends in .parquet" in refused(2, "batch", study, "-o", "victim.csv")
    kept = {path.name: path.read_bytes() for path in here.rglob("*.*") if path.is_file()}
    assert kept == {"victim.zip": b"another study", "victim.csv": b"a log", "study.toml": b"a third"}
    ok("export", one_joint, "-o", "victim.zip", "-o", "r.json", "-o", "cell/r.toml", "--overwrite")
    assert study_digest(load_study("victim.zip")) == study_digest(load_study(one_joint))
    first = (here / "r.json").read_bytes()
    (here / "r.json").write_text("an earlier result", "utf-8")
    assert "--overwrite" in refused(1, "export", one_joint, "-o", "r.json")
    ok("export", one_joint, "-o", "r.json", "--overwrite")
    assert (here / "r.json").read_bytes() == first


def test_a_corrected_mapping_is_replaced_only_when_asked(here: Path) -> None:
    time = np.arange(500) / 500
    rows = "\n".join(f"{t:.4f},{np.sin(20 * t):.6f},{np.cos(20 * t):.6f}" for t in time)
    (here / "log.csv").write_text("time [s],position [rad],torque [Nm]\n" + rows, "utf-8")
    (here / "m.json").write_text("corrected by hand", "utf-8")
    assert "--overwrite" in refused(1, "convert", "log.csv", "--guess", "m.json")
    assert (here / "m.json").read_text("utf-8") == "corrected by hand"
    ok("convert", "log.csv", "--guess", "m.json", "--overwrite")
    assert "joints" in json.loads((here / "m.json").read_text("utf-8"))


# --- the program itself


def test_the_package_itself_is_the_program_and_begins_without_heavy_modules(
    one_joint: Path, tmp_path: Path
) -> None:
    heavy = ["rich", "pandas", "pymunk", "plotly", "streamlit", "reportlab", "control", "pyarrow"]
    text = f"""
import atexit, sys, runpy, jointid.cli
print([m for m in {[*heavy, "scipy.io"]} if m in sys.modules], file=sys.stderr)
slow = "scipy.signal", "scipy.stats"  # a third of a second each
atexit.register(lambda: print([m for m in slow if m in sys.modules], file=sys.stderr))
runpy.run_module("jointid", run_name="__main__", alter_sys=True)  # as python -m jointid
"""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "utf-8"}
    command = [sys.executable, "-c", text, "identify", str(one_joint), "--json"]
    good = subprocess.run(command, capture_output=True, cwd=tmp_path, env=environment, check=True)
    assert good.stderr.split() == [b"[]", b"[]"]
    assert json.loads(good.stdout)["kind"] == "jointid identification"


@pytest.mark.parametrize(
    "module",
    [
        pytest.param("typer", marks=pytest.mark.long),
        pytest.param("jointid.cli.plan", marks=pytest.mark.long),
        "jointid.files.study_files",
    ],
)
def test_ctrl_c_while_modules_load_ends_it_quietly(module: str, study: Path) -> None:
    """As if the key were pressed the moment this module is loaded."""
    text = (
        "import sys\n"
        "class Key:\n"
        "    def find_spec(self, name, *_):\n"
        f"        if name == {module!r}: raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Key())\n"
        f"sys.argv = ['jointid', 'identify', {str(study)!r}]\n"
        "from jointid.cli import app\n"
        "app()\n"
    )
    ended = subprocess.run([sys.executable, "-c", text], capture_output=True, cwd=ROOT, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, b"", b"")


def test_version() -> None:
    assert ok("--version") == f"jointid {jointid.__version__}\n" == f"jointid {__version__}\n"


def test_the_app_is_named_when_it_is_missing(tmp_path: Path) -> None:
    assert "does not exist. Give --path" in refused(1, "app", "--path", tmp_path / "app.py")


def test_the_app_of_the_checkout_is_started_and_ends_its_server(monkeypatch: pytest.MonkeyPatch) -> None:
    """A server that outlives a terminated ``jointid app`` would keep the port."""
    called: list[Any] = []

    class Started:
        def __init__(self, command: list[str], **more: Any) -> None:
            called.append((command, more["cwd"]))

        def __enter__(self) -> Started:
            return self

        def __exit__(self, *_: object) -> None:
            pass

        def terminate(self) -> None:
            called.append("terminated")

        def wait(self) -> int:
            os.kill(os.getpid(), signal.SIGTERM)
            return -signal.SIGTERM

    monkeypatch.setattr(subprocess, "Popen", Started)
    before = signal.getsignal(signal.SIGTERM)
    try:
        ok("app", "--port", 8600)
    finally:
        signal.signal(signal.SIGTERM, before)
    (command, folder), ended = called
    assert command[1:] == ["-m", "jointid.ui.server", str(ROOT / "app.py"), "8600"]
    assert folder == ROOT
    assert ended == "terminated"


def test_files_are_written_completely_or_not_at_all(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    write_file(target, b"one")
    write_file(target, b"two")
    assert target.read_bytes() == b"two"
    (tmp_path / "folder").mkdir()
    with pytest.raises(JointIdError, match="cannot be written"):
        write_file(tmp_path / "folder", b"three")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.txt", "folder"]


def test_json_has_null_for_nan_and_infinity() -> None:
    assert with_infinite_as(None, {"a": [1.0, float("nan")], "b": (float("inf"), "x", 3)}) == {
        "a": [1.0, None],
        "b": [None, "x", 3],
    }


def test_convert_takes_a_zip_of_logs_and_their_poses(here: Path) -> None:
    """Every log of an archive is one of the study's, in its pose."""
    rng = np.random.default_rng(3)
    time = np.arange(4000) / 1000
    with zipfile.ZipFile(here / "logs.zip", "w") as archive:
        for k, hertz in enumerate((3.0, 5.0)):
            wave = np.sin(2 * np.pi * hertz * time) + 1e-4 * rng.standard_normal(time.size)
            rows = "\n".join(f"{t:.4f},{w:.6f},{2 * w:.6f}" for t, w in zip(time, wave, strict=True))
            archive.writestr(f"{k}.csv", "time [s],position [rad],torque [Nm]\n" + rows)
    (here / "robot.toml").write_text("M = [0.0025]\nM2 = [[0.004]]\n[poses.far]\nM2 = [[0.006]]\n")
    ok("convert", "logs.zip", "--guess", "m.json")
    known = ("--mapping", "m.json", "--inertia", "robot.toml")
    ok("convert", "logs.zip", *known, "--pose", "far", "--output", "study")
    study = load_study("study")
    assert [record.frequency_hz for record in study.records] == pytest.approx([3.0, 5.0], rel=1e-4)
    assert {record.pose for record in study.records} == {"far"}
    assert study.poses["far"].M2.tolist() == [[0.006]]
    assert study.name == "logs"
    (here / "robot.toml").write_text('name = "Cell 7"\nM = [0.0025]\nM2 = [[0.004]]\n')
    for given, name in (((), "Cell 7"), (("--name", "Mine"), "Mine")):
        ok("convert", "logs.zip", *known, *given, "--output", "study", "--overwrite")
        assert load_study("study").name == name
    which = ("--robot", "cell 7", "--date", "2026-11-20")
    ok("convert", "logs.zip", *known, *which, "--output", "study", "--overwrite")
    assert load_study("study").robot == "cell 7"
    assert str(load_study("study").date) == "2026-11-20"
    message = refused(1, "convert", "logs.zip", *known, "--date", "20.11.2026", "-o", "other")
    assert "'20.11.2026' is not a date: write year, month and day as in 2026-11-20." in message


@pytest.mark.parametrize(
    ("logs", "name"),
    [
        (["cell_3.csv"], "cell 3"),
        (["a.csv", "b.csv", "c.csv"], "a and 2 more"),
        (["logs.zip/1.csv", "logs.zip/2.csv"], "logs"),
        (["logs.zip/1.csv", "2.csv"], "1 and 1 more"),
        (["book.xlsx: Sheet1", "book.xlsx: Sheet2"], "book"),
        ([], ""),
    ],
)
def test_a_study_is_named_after_its_logs(logs: list[str], name: str) -> None:
    assert study_name(logs) == name
