"""Batches: one exact row per study, even if other studies crash or the batch is interrupted."""

from __future__ import annotations

import io
import json
import os
import re
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Iterator
from contextlib import closing
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest
from fleet_studies import Here, batch, poison, small_study, with_poison, write_studies
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from jointid import JointIdError, analyse, load_study, save_study
from jointid.background.child_process import Child, Ended
from jointid.cli import app
from jointid.files import container_limits as contained
from jointid.files import study_parts
from jointid.files.application import sample_studies
from jointid.files.digest import study_digest
from jointid.fleet import Limits, Row, analyse_fleet, find_studies, read_fleet, studies, worker
from jointid.fleet.jobs import WORKER, Job, Local
from jointid.fleet.journal import Journal
from jointid.fleet.row import from_plain, row_of, to_plain
from jointid.fleet.run import journal_path
from jointid.fleet.studies import content_digest, packed, path_text
from jointid.fleet.worker import answer, study_row

COUNT = 6
posix = pytest.mark.skipif(os.name != "posix", reason="signals")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fleet")


@pytest.fixture(scope="module")
def paths(folder: Path) -> list[Path]:
    return write_studies(folder, COUNT)


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("jointid.fleet.run.Local", Here)


@pytest.fixture(scope="module")
def truth(paths: list[Path]) -> dict[str, Row]:
    """What the plain loop says."""
    return {
        str(p): row_of(analyse(load_study(p)), study=str(p), content=content_digest(p)) for p in paths
    }


def without_time(row: Row) -> Row:
    return replace(row, time_s=0.0)


def require_exact(rows: tuple[Row, ...], truth: dict[str, Row]) -> None:
    """Every good row is there, exact, once, in order."""
    good = [without_time(row) for row in rows if row.is_good]
    assert [row.study for row in good] == list(truth)
    assert good == list(truth.values())


# --- rows


def test_a_row_holds_the_results_of_the_analysis(paths: list[Path], truth: dict[str, Row]) -> None:
    for path in paths[:4]:
        study, row = load_study(path), truth[str(path)]
        fit = analyse(study).fit
        assert tuple(fit.K.tolist()) == row.K
        assert tuple(fit.D.tolist()) == row.D
        assert (*row.K_error, *row.D_error) == tuple(fit.standard_error.tolist())
        assert (row.name, row.robot) == (study.name, study.robot)
        assert row.date == study.date.isoformat()
        assert row.digest == study_digest(study)
        assert (row.joints, row.records) == (study.inertia.n, len(study.records))
        assert row.verdict in ("good", "warning", "problem")
        assert row.findings[0].startswith(row.verdict)


def test_friction_and_delay_are_in_the_row(sample_folder: Path) -> None:
    study = load_study(sample_folder / "one_joint")
    analysis = analyse(study)
    from jointid.estimation.elasticity import Friction

    friction = Friction(np.array([0.1]), np.array([0.2]), np.array([0.01, 0.02]))
    fit = replace(analysis.fit, friction=friction, delay=1e-3, delay_error=1e-5)
    row = row_of(replace(analysis, fit=fit), study="x")
    assert (row.coulomb, row.viscous, row.delay_s, row.delay_error_s) == ((0.1,), (0.2,), 1e-3, 1e-5)
    assert row.model == "elasticity + friction + delay"
    assert row.date == ""  # never invented


def test_rows_survive_json_and_parquet_to_the_last_bit(truth: dict[str, Row], tmp_path: Path) -> None:
    from jointid.fleet.row import failed_row
    from jointid.fleet.table import to_parquet

    rows = (*truth.values(), failed_row("/a\nb.zip", "auto", "time", "It took …", time_s=1.5))
    assert tuple(from_plain(json.loads(json.dumps(to_plain(row)))) for row in rows) == rows
    (tmp_path / "r.parquet").write_bytes(to_parquet(rows))
    assert read_fleet(tmp_path / "r.parquet") == rows
    table = pyarrow.parquet.read_table(tmp_path / "r.parquet")
    assert table["K1"].to_pylist()[:-1] == [row.K[0] for row in truth.values()]
    assert table["K2_error"].null_count == 1 + sum(row.joints < 2 for row in truth.values())


@pytest.mark.parametrize("change", ["kind", "column", "value", "bytes", "joints"])
def test_a_table_that_was_changed_is_refused(truth: dict[str, Row], tmp_path: Path, change: str) -> None:
    import pyarrow as pa

    from jointid.fleet.table import to_parquet

    path = tmp_path / "r.parquet"
    path.write_bytes(to_parquet(list(truth.values())))
    table = pyarrow.parquet.read_table(path)
    if change == "kind":
        table = table.replace_schema_metadata(None)
    elif change == "column":
        table = table.drop_columns(["verdict"])
    elif change == "bytes":
        path.write_bytes(path.read_bytes()[:-30])
        with pytest.raises(JointIdError, match="cannot be read as Parquet"):
            read_fleet(path)
        return
    else:
        name, values = {
            "value": ("misfit", pa.array(["x"] * len(table))),
            "joints": ("joints", pa.array([-1] * len(table))),
        }[change]
        table = table.set_column(table.schema.get_field_index(name), name, values)
    pyarrow.parquet.write_table(table, path)
    with pytest.raises(JointIdError):
        read_fleet(path)


# --- which studies


def test_studies_are_found_once_and_in_order(paths: list[Path], folder: Path) -> None:
    assert list(find_studies([folder])) == paths  # 2 before 10
    assert list(find_studies([f"{folder}/*"])) == paths
    assert list(find_studies([f"{folder}/**", folder, *paths])) == paths
    assert list(find_studies([folder / "4" / "study.toml"])) == [folder / "4"]
    assert list(find_studies([paths[3], folder]))[:2] == [paths[3], paths[0]]
    assert set(find_studies([f"{folder}/*.zip"])) == {p for p in paths if p.suffix}


def test_folders_are_searched_at_any_depth_and_links_only_once(tmp_path: Path) -> None:
    deep = tmp_path / "a" / "b"
    deep.mkdir(parents=True)
    save_study(small_study(0), deep / "s")
    save_study(small_study(0), deep / ".hidden.zip")
    (deep / "s" / "old.zip").write_bytes(b"part of that folder, not a study")
    (deep / "round").symlink_to(tmp_path)
    (tmp_path / "same").symlink_to(deep / "s")
    assert list(find_studies([tmp_path])) == [deep / "s"]


@pytest.mark.usefixtures("here")
def test_a_study_found_by_several_paths_has_one_row(tmp_path: Path) -> None:
    (tmp_path / "cells" / "deep").mkdir(parents=True)
    save_study(small_study(0), tmp_path / "cells" / "s")
    (tmp_path / "link").symlink_to(tmp_path / "cells" / "s")
    (tmp_path / "way").symlink_to(tmp_path / "cells" / "deep")
    out = tmp_path / "r.parquet"
    analyse_fleet([tmp_path / "cells"], out, workers=1)
    (row,) = read_fleet(out)
    ways = [f"{tmp_path}/{way}" for way in ("link", "link/study.toml", "way/..", "way/../s", "l*")]
    assert {find_studies([way]) for way in ways} == {(Path(row.study),)}
    again = analyse_fleet(ways, out, workers=1)
    assert (again.studies, again.skipped, again.kept) == (1, 1, 0)
    assert read_fleet(out) == (row,)
    assert row.study == os.path.realpath(tmp_path / "cells" / "s")


@posix
@pytest.mark.usefixtures("here")
def test_different_paths_are_displayed_differently(tmp_path: Path) -> None:
    names = [b"x\xff", b"x\\xff", b"x\\x5cxff", b"x\\\xff", b"x\\x5\xff", "x\u00ff".encode(), b"x\\n"]
    folders = [tmp_path / os.fsdecode(name) for name in names]
    for k, folder in enumerate(folders):
        save_study(small_study(k), folder)
    out = tmp_path / "r.parquet"
    analyse_fleet(folders, out, workers=1)
    rows = read_fleet(out)
    assert [row.name for row in rows] == [f"cell {k}" for k in range(len(names))]
    assert [Path(row.study).name for row in rows[-2:]] == ["x\u00ff", "x\\n"]  # as they are


@given(st.binary(max_size=12) | st.text("\\x5cf8\u00e4", max_size=12).map(os.fsencode))
def test_a_displayed_path_is_resolved_to_the_file(name: bytes) -> None:
    path = Path(os.fsdecode(b"/" + name.replace(b"\0", b"").replace(b"/", b"")))
    text = path_text(path)
    text.encode()  # a table can hold it
    back = re.sub(rb"\\x([89a-f][0-9a-f]|5c)", lambda found: bytes([int(found[1], 16)]), text.encode())
    assert back == os.fsencode(path)


def test_an_empty_batch_is_an_error(tmp_path: Path) -> None:
    for paths, text in (([tmp_path], "holds no study"), ([f"{tmp_path}/*.zip"], "matches no study")):
        with pytest.raises(JointIdError, match=text):
            find_studies(paths)
    with pytest.raises(JointIdError, match="No study is given"):
        find_studies([])
    with pytest.raises(JointIdError, match=r"gone\.zip: no such file or folder"):
        find_studies([tmp_path / "gone.zip"])
    # What is there gets its row, which says what is wrong.
    (tmp_path / "log.csv").touch()
    assert find_studies([tmp_path / "log.csv"]) == (tmp_path / "log.csv",)


def test_the_robot_model_is_one_of_the_files(tmp_path: Path) -> None:
    save_study(small_study(0), tmp_path / "s")
    with zipfile.ZipFile(sample_studies()["six_axes"]) as sample:
        (tmp_path / "s" / "robot.toml").write_bytes(sample.read("robot.toml"))
    first = content_digest(tmp_path / "s")
    with zipfile.ZipFile(io.BytesIO(packed(tmp_path / "s"))) as sent:
        assert "robot.toml" in sent.namelist()
    with (tmp_path / "s" / "robot.toml").open("a") as robot:
        robot.write("# another payload\n")
    assert content_digest(tmp_path / "s") != first


def test_the_digest_of_the_files_changes_with_any_byte(tmp_path: Path) -> None:
    save_study(small_study(0), tmp_path / "s")
    first = content_digest(tmp_path / "s")
    (tmp_path / "s" / "notes.txt").write_text("not part of the study")
    assert content_digest(tmp_path / "s") == first
    file = tmp_path / "s" / "records" / "02.csv"
    data = file.read_bytes()
    file.write_bytes(data[:-2] + b"1\n")
    second = content_digest(tmp_path / "s")
    file.rename(file.with_name("03.csv"))
    third = content_digest(tmp_path / "s")
    assert len({first, second, third}) == 3


@pytest.fixture
def scaled_down(monkeypatch: pytest.MonkeyPatch) -> None:
    """Limits a few thousand times smaller: 16 kB stand for 1 GiB, and records above 8 kB are long."""
    for module in (contained, studies):
        monkeypatch.setattr(module, "MAX_TOTAL_BYTES", 1 << 14)
    monkeypatch.setattr(study_parts, "LONG_BYTES", 1 << 13)
    monkeypatch.setattr(study_parts, "_PART_SAMPLES", 100)
    monkeypatch.setattr(study_parts, "_PART_PERIODS", 1)


@pytest.mark.usefixtures("scaled_down")
def test_a_study_beyond_the_limits_of_an_archive_is_analysed_anew_when_its_data_change(
    tmp_path: Path,
) -> None:
    path = tmp_path / "long"
    save_study(small_study(1), path, record_format="parquet")
    files = sorted((path / "records").iterdir())
    assert sum(file.stat().st_size for file in files) > 2 * contained.MAX_TOTAL_BYTES
    first = study_row(path, "x", "auto")
    assert first is not None
    assert not first.error
    assert study_row(path, "x", "auto", known=first.content) is None
    save_study(small_study(3), path, record_format="parquet", overwrite=True)
    second = study_row(path, "x", "auto", known=first.content)
    assert second is not None
    assert second.name == "cell 3"
    assert second.K != first.K
    data = bytearray(files[-1].read_bytes())
    data[len(data) // 2] ^= 1
    files[-1].write_bytes(data)  # one bit, in the last file of all
    assert content_digest(path) != second.content
    assert first.version == second.version


@pytest.mark.usefixtures("scaled_down")
@pytest.mark.parametrize("limit", ["a long record", "the size of all files"])
def test_a_study_too_large_to_send_is_refused_and_analysed_locally(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: str
) -> None:
    path = tmp_path / "long"
    save_study(small_study(1), path, record_format="parquet")
    if limit == "a long record":
        monkeypatch.setattr(studies, "MAX_TOTAL_BYTES", 1 << 30)
    else:
        monkeypatch.setattr(study_parts, "LONG_BYTES", 1 << 30)
    with pytest.raises(JointIdError, match=r"cannot be sent to a cluster: .*\.parquet is too long"):
        packed(path)
    about = {"do": "pack", "study": "x", "method": "auto", "known": "", "path": str(path)}
    refused = from_plain(answer(about, b"", lambda done: None)[0]["row"])
    assert (refused.failure, refused.content) == ("refused", "")  # known by no content: tried again
    monkeypatch.setattr(study_parts, "LONG_BYTES", 1 << 13)
    assert study_row(path, "x", "auto", known=refused.content).is_good


def test_unreadable_files_are_classified_by_their_kind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_study(small_study(0), tmp_path / "s")
    whole = content_digest(tmp_path / "s")
    file = tmp_path / "s" / "records" / "02.csv"
    opened = Path.open

    def no_such_luck(path: Path, *arguments: str) -> object:
        if path == file.resolve():
            raise PermissionError(13, "Permission denied")
        return opened(path, *arguments)

    with monkeypatch.context() as context:
        context.setattr(Path, "open", no_such_luck)
        closed = content_digest(tmp_path / "s")
        with pytest.raises(
            JointIdError, match=r"records/02\.csv in .* cannot be read: Permission denied"
        ):
            packed(tmp_path / "s")
    data = file.read_bytes()
    file.unlink()
    file.symlink_to(tmp_path / "outside.csv")
    (tmp_path / "outside.csv").write_bytes(data)  # a link that leaves the folder
    led_away = content_digest(tmp_path / "s")
    assert len({whole, closed, led_away}) == 3
    with pytest.raises(JointIdError, match=r"02\.csv is missing"):
        load_study(packed(tmp_path / "s"))


def test_a_study_sent_to_a_worker_is_unchanged(paths: list[Path]) -> None:
    for path in paths[:5]:
        assert study_digest(load_study(packed(path))) == study_digest(load_study(path))


# --- the batch


def test_every_row_is_exact_and_a_second_run_analyses_only_what_changed(
    paths: list[Path], truth: dict[str, Row], tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    out = tmp_path / "r.parquet"
    seen: list[int] = []
    summary = analyse_fleet(paths, out, workers=1, progress=lambda p: seen.append(p.done))
    require_exact(read_fleet(out), truth)
    assert (summary.studies, summary.good, summary.skipped, summary.kept) == (COUNT, COUNT, 0, 0)
    assert seen == list(range(COUNT + 1))
    assert [p.name for p in tmp_path.iterdir()] == ["r.parquet"]  # the journal is gone

    request.getfixturevalue("here")
    changed = tmp_path / "changed.zip"
    save_study(small_study(100), changed)
    analyse_fleet([*paths[:3], changed], out, workers=1)
    save_study(small_study(101), changed, overwrite=True)
    again = analyse_fleet([changed, *paths[:3]], out, workers=1)
    assert (again.studies, again.skipped, again.kept) == (4, 3, COUNT - 3)
    rows = read_fleet(out)
    assert [row.study for row in rows] == [str(p) for p in (changed, *paths)]
    assert rows[0].name == "cell 101"
    require_exact(rows[1:], truth)

    other = analyse_fleet(paths[:2], out, workers=1, method="explicit")
    assert other.skipped == 0
    assert [row.method for row in read_fleet(out)[:3]] == ["explicit", "explicit", "auto"]
    assert analyse_fleet(paths[:1], out, workers=1, method="explicit", fresh=True).skipped == 0
    assert len(read_fleet(out)) == 1


@posix
def test_six_faulty_studies_do_not_stop_a_batch(
    paths: list[Path],
    truth: dict[str, Row],
    tmp_path: Path,
    request: pytest.FixtureRequest,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bad = poison(tmp_path) | {"greedy": tmp_path / "greedy.zip"}
    bad["greedy"].write_bytes(paths[0].read_bytes())
    mixed = [
        bad["hangs"],
        *paths[:6],
        *list(bad.values())[:3],
        bad["greedy"],
        bad["crashes"],
        *paths[6:],
    ]
    out = tmp_path / "r.parquet"
    with monkeypatch.context() as context:
        context.setenv("PYTHONPATH", with_poison(tmp_path / "p")["PYTHONPATH"])
        options = ["--output", str(out), "--workers", "2", "--timeout", "2"]
        ended = CliRunner().invoke(app, ["batch", *map(str, mixed), *options])
    assert ended.exit_code == 0, ended.stderr
    assert f"{COUNT + 6} studies, {COUNT} of them with an answer" in ended.stdout
    assert "Failed: 6" in ended.stderr
    assert f"{bad['nan']}: records/01.csv" in ended.stderr
    rows = read_fleet(out)
    assert [row.study for row in rows] == [str(p) for p in mixed]
    require_exact(rows, truth)
    errors = {Path(row.study).stem: (row.failure, row.error) for row in rows if not row.is_good}
    kinds = {name: failure for name, (failure, _) in errors.items()}
    assert kinds == dict.fromkeys(["nan", "missing", "broken"], "refused") | {
        "hangs": "time",
        "greedy": "memory",
        "crashes": "crash",
    }
    assert "records/01.csv" in errors["nan"][1]
    assert "02.csv is missing" in errors["missing"][1]
    assert "more than 2 s" in errors["hangs"][1]
    assert "SIGSEGV" in errors["crashes"][1]
    # Nothing of it stays as it is for ever: where time or a process failed, the next run tries again.
    request.getfixturevalue("here")
    healed = analyse_fleet(mixed, out, workers=1)
    assert (healed.skipped, healed.good) == (COUNT + 3, COUNT + 3)


def marked(mark: str) -> list[int]:
    """Processes that live in an environment with this mark."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            if mark.encode() in (entry / "environ").read_bytes():
                found.append(int(entry.name))
        except OSError:
            continue
    return found


def journal_lines(out: Path) -> int:
    path = journal_path(out)
    return path.read_bytes().count(b"\n") - 1 if path.exists() else 0


def wait_for(condition: object, limit_s: float = 60.0) -> None:
    begin = time.monotonic()
    while not condition():
        assert time.monotonic() - begin < limit_s
        time.sleep(0.05)


@pytest.fixture
def env(tmp_path: Path) -> Iterator[dict[str, str]]:
    """An environment with a mark; whatever lives in it at the end is ended."""
    environment = with_poison(tmp_path / "p") | {"FLEET_MARK": f"mark:{tmp_path}:"}
    yield environment
    for process in marked(environment["FLEET_MARK"]):
        os.kill(process, signal.SIGKILL)


@posix
@pytest.mark.parametrize(
    "how",
    [
        pytest.param(signal.SIGKILL, id="kill -9", marks=pytest.mark.long),
        pytest.param(signal.SIGINT, id="Ctrl-C"),
    ],
)
def test_an_interrupted_batch_resumes(
    paths: list[Path],
    truth: dict[str, Row],
    tmp_path: Path,
    env: dict[str, str],
    how: int,
    request: pytest.FixtureRequest,
) -> None:
    out = tmp_path / "r.parquet"
    stuck = [tmp_path / name / "hangs.zip" for name in "ab"]  # one for each worker
    for path in stuck:
        path.parent.mkdir()
        path.write_bytes(paths[0].read_bytes())
    command = batch(*paths[:5], *stuck, *paths[5:], "--out", out, "--workers", 2, env=env)
    wait_for(lambda: journal_lines(out) >= 3)
    command.send_signal(how)
    _, said = command.communicate(timeout=60)
    wait_for(lambda: not marked(env["FLEET_MARK"]))  # no process is left behind
    assert not out.exists()
    if how == signal.SIGINT:
        assert command.returncode == 130
        assert "resumes the batch" in said
        assert "Traceback" not in said
    journal = journal_path(out)
    with journal.open("ab") as file:  # as if the power had failed in the middle of a line
        file.write(journal.read_bytes().splitlines()[-1][:40])
    kept = [from_plain(json.loads(line)) for line in journal.read_bytes().splitlines()[1:-1]]
    assert 3 <= len(kept) < COUNT
    if how == signal.SIGINT:
        request.getfixturevalue("here")
        summary = analyse_fleet(paths, out)
        assert (summary.skipped, summary.good) == (len(kept), COUNT)
    else:
        again = batch(*paths, "--out", out, "--workers", 1, "--json", env=env)
        printed, said = again.communicate(timeout=120)
        assert again.returncode == 0, said
        document = json.loads(printed)
        assert (document["skipped"], document["good"]) == (len(kept), COUNT)
    rows = read_fleet(out)
    require_exact(rows, truth)
    assert set(kept) <= set(rows)  # their very times: nothing was done twice
    assert not journal.exists()


@pytest.mark.usefixtures("here")
def test_the_rows_of_an_interrupted_batch_are_kept(
    paths: list[Path], truth: dict[str, Row], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As by the processes of the test above, in this one."""
    out = tmp_path / "r.parquet"
    journal = journal_path(out)

    def interrupted(*job: Any) -> Row | None:
        if journal_lines(out) == 3:
            raise KeyboardInterrupt
        return study_row(*job)

    with monkeypatch.context() as context:
        context.setattr(worker, "study_row", interrupted)
        ended = CliRunner().invoke(app, ["batch", *map(str, paths), "--out", str(out)])
    assert ended.exit_code == 130
    assert "resumes the batch" in ended.stderr
    assert not out.exists()
    lines = journal.read_bytes().splitlines()
    journal.write_bytes(b"\n".join([*lines, lines[-1][:40]]))  # as if the power had failed in a line
    kept = [from_plain(json.loads(line)) for line in lines[1:]]
    summary = analyse_fleet(paths, out)
    assert (len(kept), summary.skipped, summary.good) == (3, 3, COUNT)
    rows = read_fleet(out)
    require_exact(rows, truth)
    assert set(kept) <= set(rows)
    assert not journal.exists()


@pytest.mark.usefixtures("here")
def test_two_batches_do_not_write_the_same_table(paths: list[Path], tmp_path: Path) -> None:
    pytest.importorskip("fcntl")
    out = tmp_path / "r.parquet"
    journal = Journal(journal_path(out))
    with pytest.raises(JointIdError, match="being written by another batch"):
        analyse_fleet(paths[:1], out)
    journal.close()
    assert analyse_fleet(paths[:1], out, workers=1).good == 1


def test_unrelated_files_are_not_changed(paths: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "mine.parquet"
    out.write_bytes(b"my thesis")
    for fresh in (False, True):
        with pytest.raises(JointIdError, match="not overwritten"):
            analyse_fleet(paths[:1], out, fresh=fresh)
    assert out.read_bytes() == b"my thesis"
    assert not journal_path(out).exists()  # no row, no journal
    other = tmp_path / "r.parquet"
    journal_path(other).write_text("dear diary\n")
    with pytest.raises(JointIdError, match="not the journal of a batch"):
        analyse_fleet(paths[:1], other)
    assert journal_path(other).read_text() == "dear diary\n"
    with pytest.raises(JointIdError, match="not a folder"):
        analyse_fleet(paths[:1], tmp_path / "none" / "r.parquet")


WRONG = {
    "study": 5,
    "content": None,
    "name": "\ud800",  # half a character
    "findings": ["good", 1],
    "joints": 10**9,
    "records": "2",
    "time_s": float("nan"),
    "misfit": "1",
    "K": [1.0] * 9,
    "D": 3.0,
    "K_error": [-1.0],
    "delay_s": "1",
    "verdict": "<b>",
    "failure": "bad luck",
    "date": "soon",
    "new": 1,
}
"""Values that no batch writes, by field."""


def test_a_damaged_line_of_the_journal_loses_only_its_row(truth: dict[str, Row], tmp_path: Path) -> None:
    rows, path = list(truth.values())[:3], tmp_path / "j"
    journal = Journal(path)
    for row in rows:
        journal.add(row)
    journal.close()
    head, first, middle, last = path.read_bytes().splitlines(keepends=True)
    plain = json.loads(middle)
    lines = [b"\x00" * 20, b"null", b"5", b"[1]", b'"x"', b"{}", b"[" * 100_000, b"\xff", b""]
    lines += [json.dumps(plain | {name: value}).encode() for name, value in WRONG.items()]
    lines += [json.dumps({k: v for k, v in plain.items() if k != "time_s"}).encode()]
    for damaged in lines:
        path.write_bytes(head + first + damaged + b"\n" + last)
        with closing(Journal(path)) as again:
            assert again.rows == (rows[0], rows[2]), damaged[:60]
    path.write_bytes(head + first + middle + last)
    with closing(Journal(path)) as whole:
        assert whole.rows == tuple(rows)


# --- the process


@posix
def test_a_process_killed_while_idle_is_replaced(paths: list[Path]) -> None:
    child = Child(WORKER, Limits(time_s=30))
    request = {"do": "analyse", "study": "x", "method": "explicit", "known": "", "path": str(paths[0])}
    request["content"] = ""
    first = child.ask(request)[0]["row"]
    os.kill(child._process.pid, signal.SIGKILL)
    assert child.ask(request)[0]["row"]["K"] == first["K"]
    child.stop()
    with pytest.raises(Ended):
        child.ask(request)


@posix
def test_a_running_study_can_be_cancelled(
    paths: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Long before its limit, which is beyond that of this test."""

    class Stopped(Exception):
        pass

    rows: list[Row | None] = []

    def stop() -> None:
        if rows:
            raise Stopped

    bad = poison(tmp_path)
    monkeypatch.setenv("PYTHONPATH", with_poison(tmp_path / "p")["PYTHONPATH"])
    jobs = [Job("good", paths[0]), Job("endless", bad["hangs"]), Job("later", paths[1])]
    with closing(Local(1, Limits(time_s=1000), waiting=stop).run(jobs)) as finished:
        rows.append(next(finished).row)
        with pytest.raises(Stopped):
            next(finished)
    assert [row and row.study for row in rows] == ["good"]
    assert all(row and row.is_good for row in rows)


def test_invalid_limits_are_refused() -> None:
    with pytest.raises(JointIdError, match="time_s"):
        Limits(time_s=0)
    with pytest.raises(JointIdError, match="memory_bytes"):
        Limits(memory_bytes=1000)


def test_a_failed_process_start_gives_its_reason(
    paths: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sitecustomize.py").write_text("import sys; sys.exit('no licence')", "utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with pytest.raises(JointIdError, match=r"did not start .* no licence"):
        analyse_fleet(paths[:3], tmp_path / "r.parquet", workers=2)


# --- the command


@pytest.mark.parametrize("address", ["x", pytest.param("tls://127.0.0.1:9", marks=pytest.mark.long)])
def test_an_invalid_cluster_address_is_one_message(
    paths: list[Path], tmp_path: Path, address: str
) -> None:
    pytest.importorskip("distributed")
    command = [sys.executable, "-m", "jointid", "batch", str(paths[0]), "--scheduler", address]
    command += ["-o", str(tmp_path / "r.parquet")]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
    assert ended.returncode == 1
    (said,) = ended.stderr.splitlines()
    assert said.startswith(f"Error: There is no Dask scheduler at {address} (")


def test_every_field_is_in_the_table(truth: dict[str, Row]) -> None:
    """A field missing there would be lost when a batch resumes."""
    from jointid.fleet import table

    named = {*table._HEAD, *table._TAIL, *table._JOINTWISE}
    assert named == {field.name for field in fields(Row)}
