"""A batch on a real Dask cluster: killing a worker neither loses nor duplicates a row."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from fleet_studies import poison, write_studies

from jointid import JointIdError, analyse, load_study
from jointid.fleet import Progress, Summary, analyse_fleet, read_fleet
from jointid.fleet.row import Row, row_of
from jointid.fleet.studies import content_digest

# Dask warns, from its own threads, of ports taken by its dashboard and of workers that are restarted.
pytestmark = [
    pytest.mark.filterwarnings("default::UserWarning:distributed"),
    pytest.mark.filterwarnings("default::ResourceWarning"),
    pytest.mark.filterwarnings("default::pytest.PytestUnraisableExceptionWarning"),
    pytest.mark.long,
]

COUNT = 10


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """A scheduler with two workers, each a process of one thread."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        yield cluster.scheduler_address


@pytest.fixture(scope="module")
def truth(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Row]:
    """Results of the plain loop, by path."""
    paths = write_studies(tmp_path_factory.mktemp("fleet"), COUNT)
    return {
        str(p): row_of(analyse(load_study(p)), study=str(p), content=content_digest(p)) for p in paths
    }


@pytest.fixture(scope="module")
def mixed(truth: dict[str, Row], tmp_path_factory: pytest.TempPathFactory) -> list[str | Path]:
    """All studies but the last two, and three without an answer among them."""
    bad = poison(tmp_path_factory.mktemp("bad"))
    *paths, _, _ = truth
    return [*paths[:4], bad["nan"], bad["missing"], bad["broken"], *paths[4:]]


@pytest.fixture(scope="module")
def out(
    address: str, mixed: list[str | Path], tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, Summary]:
    """The table of a batch over which a worker was killed."""
    import distributed

    with distributed.Client(address, set_as_default=False) as client:
        workers = list(client.run(os.getpid).values())
    killed: list[int] = []

    def kill_one(progress: Progress) -> None:
        if progress.done >= 3 and not killed:
            killed.append(workers[0])
            os.kill(workers[0], signal.SIGKILL)

    table = tmp_path_factory.mktemp("out") / "r.parquet"
    summary = analyse_fleet(mixed, table, scheduler=address, progress=kill_one)
    assert killed
    return table, summary


def test_all_studies_are_analysed_when_a_worker_is_killed(
    out: tuple[Path, Summary], mixed: list[str | Path], truth: dict[str, Row]
) -> None:
    table, summary = out
    assert (summary.studies, summary.good) == (COUNT + 1, COUNT - 2)
    rows = read_fleet(table)[: len(mixed)]
    assert [row.study for row in rows] == [str(path) for path in mixed]
    good = [replace(row, time_s=0.0) for row in rows if row.is_good]
    assert good == list(truth.values())[:-2]
    assert {row.failure for row in rows if not row.is_good} == {"refused"}
    assert all(row.content for row in rows)


def test_a_batch_resumes_on_a_cluster_and_on_one_computer(
    out: tuple[Path, Summary], address: str, mixed: list[str | Path], truth: dict[str, Row]
) -> None:
    table, _ = out
    *_, one, other = truth
    here = analyse_fleet([*mixed, one], table, workers=1)
    assert (here.skipped, here.good) == (len(mixed), COUNT - 1)
    there = analyse_fleet([*mixed, one, other], table, scheduler=address)
    assert (there.skipped, there.good) == (len(mixed) + 1, COUNT)
    good = [replace(row, time_s=0.0) for row in read_fleet(table) if row.is_good]
    assert good == list(truth.values())


def test_an_unreachable_cluster_is_an_error(
    truth: dict[str, Row], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("jointid.fleet.cluster._CONNECT_S", 1.0)
    with pytest.raises(JointIdError, match=r"no Dask scheduler at tcp://127\.0\.0\.1:9 "):
        analyse_fleet(list(truth)[:1], tmp_path / "r.parquet", scheduler="tcp://127.0.0.1:9")
    with pytest.raises(JointIdError, match="There is no Dask scheduler at nonsense"):
        analyse_fleet(list(truth)[:1], tmp_path / "r.parquet", scheduler="nonsense://x")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(JointIdError, match="give one of them"):
        analyse_fleet(list(truth)[:1], tmp_path / "r.parquet", scheduler="tcp://x:1", workers=2)
