"""The benchmarks run, with complete tables and right answers; times are not tested."""

from __future__ import annotations

import gc
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from benchmarks import __main__ as runner
from benchmarks import growth
from benchmarks.harness import NOT_INSTALLED, Table, interleaved, written

pytestmark = pytest.mark.filterwarnings("default")  # other people's libraries may warn


@pytest.fixture(scope="module", autouse=True)
def no_old_garbage() -> Iterator[None]:
    """Before each round garbage is collected: not among all that the tests before have left."""
    gc.collect()
    gc.freeze()
    yield
    gc.unfreeze()


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> Iterator[None]:
    """Small matrices wait for each other's threads when the cores have other work."""
    with threadpool_limits(1, "blas"):
        yield


def numbers(table: Table, column: str) -> list[float]:
    return [float(row[column]) for row in table.rows if isinstance(row.get(column), int | float)]


def run(name: str) -> tuple[Table, ...]:
    tables = tuple(runner.run(name, quick=True))
    assert tables
    for table in tables:
        assert table.rows
        assert len(table.markdown().splitlines()) >= 4 + len(table.rows)
    return tables


def named(table: Table, start: str) -> dict[str, object]:
    first = next(iter(table.columns))
    return next(dict(row) for row in table.rows if str(row[first]).startswith(start))


def test_ratios_are_taken_within_a_round() -> None:
    order: list[str] = []
    calls = {name: lambda name=name: order.append(name) for name in ("a", "b")}
    times = interleaved(calls, against="a", rounds=3)
    assert order == ["a", "b"] * 4  # one round to warm up
    assert times["a"].ratio == 1.0
    np.testing.assert_allclose(times["b"].against, times["b"].seconds / times["a"].seconds)


def test_a_slow_contender_is_skipped_and_the_unit_is_not() -> None:
    calls = {"unit": lambda: None, "slow": lambda: None}
    times = interleaved(calls, against="unit", rounds=4, patience_s=0.0)
    assert times["unit"].seconds.size == 4
    assert times["slow"].seconds.size == 0


@pytest.mark.parametrize(
    ("value", "form", "text"),
    [
        (0.0123456, "ms", "12.3 ms"),
        (12.3456, "ms", "12,346 ms"),
        (None, "ms", ""),
        ("why", ".2f", "why"),
        (float("nan"), ".2f", "–"),
        (1.234, ".2f", "1.23"),
    ],
)
def test_cells(value: float | str | None, form: str, text: str) -> None:
    assert written(value, form) == text


def test_a_row_needs_its_column() -> None:
    with pytest.raises(ValueError, match="no column"):
        Table("x", "X", {"a": ""}, ({"b": 1.0},))


def test_phasors() -> None:
    for table in run("phasors"):
        assert len(table.rows) >= 6
        assert all(row["median"] for row in table.rows if NOT_INSTALLED not in str(row["contender"]))
        best = named(table, "**jointid**")
        for start in ("numpy.linalg.lstsq", "compiled recurrence (numba)"):
            other = named(table, start)
            if NOT_INSTALLED in str(other["contender"]):
                continue
            for column in ("error, whole periods", "error, broken periods"):
                # Least squares is least squares: all find the same answer.
                np.testing.assert_allclose(float(best[column]), float(other[column]), rtol=0.05)
        assert float(named(table, "numpy.fft")["error, broken periods"]) > 1e-4


def test_transfer_matrix() -> None:
    (table,) = run("transfer_matrix")
    for row in table.rows:
        if NOT_INSTALLED not in str(row["estimator"]):
            limit = 5.0 if "Hann" in str(row["estimator"]) else 0.2
            assert float(str(row["median error of H"]).rstrip(" %")) < limit, row


@pytest.mark.long
def test_stiffness() -> None:
    table, starts = run("stiffness")
    assert len(table.rows) == 8
    for start in ("**jointid**", "grey box in time"):
        found = named(table, start)
        if NOT_INSTALLED not in str(found["estimator"]):
            assert all(float(str(found[name])) < 1.0 for name in ("K1", "K2", "D1", "D2"))
    assert float(str(named(table, "the paper's")["D1"])) > 2  # it does not know friction
    assert len(starts.rows) == 7


@pytest.mark.long
def test_motion_peers() -> None:
    (table,) = run("motion_peers")
    for row, start in zip(table.rows, ("**jointid**", "grey box in time", "mujoco.sysid"), strict=True):
        assert str(row["estimator"]).startswith(start)
    assert all(float(str(table.rows[0][f"error of {name}, %"])) < 0.5 for name in ("K", "D", "M", "M2"))


def test_simulation() -> None:
    robot, cut = run("simulation")
    errors = numbers(robot, "largest error of an angle")
    assert max(errors[:2]) < 1e-11
    assert max(errors[2:]) < 1e-3
    assert len(cut.rows) == 2


@pytest.mark.long
def test_growth() -> None:
    (table,) = run("growth")
    assert {row["grows"] for row in table.rows} == set(growth.FULL)
    assert min(numbers(table, "phasors")) > 0


@pytest.mark.parametrize("name", ["cramer_rao", "friction"])
def test_long_parts_are_reached(name: str) -> None:
    (table,) = run(name)
    assert all(set(row) == set(table.columns) for row in table.rows)


def test_a_part_that_fails_does_not_stop_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from benchmarks import phasors, transfer_matrix

    def broken(_quick: bool) -> list[Table]:
        raise RuntimeError("a broken library")

    table = Table("transfer_matrix", "Fine", {"a": "", "b": ".1f"}, ({"a": "x", "b": float("nan")},))
    monkeypatch.setattr(phasors, "measure", broken)
    monkeypatch.setattr(transfer_matrix, "measure", lambda _quick: [table])
    file = tmp_path / "figures.json"
    assert runner.main(["phasors", "transfer_matrix", "--quick", "--json", str(file)]) == 1
    shown = capsys.readouterr().out
    assert "phasors failed: RuntimeError: a broken library" in shown
    assert "| x | – |" in shown
    found = json.loads(file.read_text("utf-8"))
    assert found["parts"]["phasors"]["error"]
    assert found["parts"]["transfer_matrix"]["tables"][0]["rows"] == [{"a": "x", "b": None}]
    assert {"cpu", "cores", "memory_GB", "python"} <= set(found["machine"])
    assert "numpy" in found["versions"]


def test_a_missing_library_is_reported_in_its_row(monkeypatch: pytest.MonkeyPatch) -> None:
    from benchmarks import harness, stiffness, transfer_matrix

    monkeypatch.setattr(stiffness, "optional", lambda _name: None)
    monkeypatch.setattr(transfer_matrix, "optional", lambda _name: None)
    assert harness.optional("no_such_library") is None
    missing = stiffness._expensive([], stiffness.QUICK, with_mujoco=True)
    assert [NOT_INSTALLED in str(row["estimator"]) for row in missing] == [True, True]
    assert NOT_INSTALLED in str(named(transfer_matrix.measure(True)[0], "pyFRF")["estimator"])


def test_an_unknown_part_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        runner.main(["phasers"])
    assert "no such part: phasers" in capsys.readouterr().err
