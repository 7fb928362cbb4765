"""Fixtures: sample studies, servers and a browser."""

from __future__ import annotations

import functools
import gc
import os
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from normal_run import COLLECTED, of_long_run, of_nightly_run
from random_cases import begin
from threadpoolctl import threadpool_limits

if TYPE_CHECKING:  # the process that only hands out the tests loads none of them
    from browsing import Server
    from playwright.sync_api import Browser, BrowserContext, Page
    from streamlit.testing.v1 import AppTest

    from jointid import Analysis, Study
    from jointid.importing.read.reader_process import ReaderProcess

LONGEST_FILES = (
    "test_motion.py",
    "test_gears.py",
    "test_verdict.py",
    "test_whole_error.py",
    "test_fleet.py",
)
"""Beside those that need a browser."""

BROWSER_TIMEOUT_S = 600
"""They wait for conditions, each by ``browsing.PATIENCE_MS`` at most; a busy machine is no fault."""

FREQUENCIES_HZ = [3.0, 7.0, 11.0, 17.0, 23.0, 29.0]


def simulated(joints: int, *, seed: int = 1) -> Study:
    """A small campaign of a robot with noise but without friction."""
    from plants import PAPER, PARALLELOGRAM, ROBOTS

    from jointid import Controller, Elasticity, Excitation, Measurement, Study, simulate_records

    inertia, elasticity = (PARALLELOGRAM, PAPER) if joints == 2 else ROBOTS[joints]
    records = simulate_records(
        inertia,
        elasticity,
        FREQUENCIES_HZ,
        excitation=Excitation(duration_s=1.5),
        controller=Controller(sample_rate_hz=1000.0),
        measurement=Measurement(encoder_counts=1 << 20, torque_noise_Nm=0.005),
        seed=seed,
    )
    return Study(
        records=records,
        inertia=inertia,
        nominal=Elasticity(K=0.5 * elasticity.K, D=elasticity.D),
        name=f"Test cell with {joints} joint(s)",
        origin="simulated",
        description="Made by the tests.",
    )


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--long", action="store_true", help="run the tests marked long, too, as CI does")
    parser.addoption("--nightly", action="store_true", help="run every variant of every test")


def pytest_configure(config: pytest.Config) -> None:
    """Choose the number of random cases; one thread for linear algebra; and keep compiled modules.

    Matrices are small here: further threads would only wait for work, each on a core that another worker
    of pytest-xdist needs. Compiling a module takes longer than to run it, in every process anew.
    """
    begin(_run(config))
    gc.disable()  # until pytest_collection_finish: reading the tests makes a million lasting objects
    os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}  # of what is started later
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    sys.dont_write_bytecode = False
    threadpool_limits(1)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what belongs to longer runs; begin the longest files first.

    Whole files go to a worker: a long one at the end would leave the other cores idle.
    """
    config.stash[COLLECTED] = {_name(item) for item in items}
    tried = {"normal": _is_normal, "long": _is_of_ci, "nightly": lambda _: True}[_run(config)]
    config.hook.pytest_deselected(items=[item for item in items if not tried(item)])
    items[:] = [item for item in items if tried(item)]
    for item in items:
        if item.get_closest_marker("browser"):
            item.add_marker(pytest.mark.timeout(BROWSER_TIMEOUT_S))
    items.sort(
        key=lambda item: (not item.get_closest_marker("browser"), item.path.name not in LONGEST_FILES)
    )


def _run(config: pytest.Config) -> str:
    """Kind of run, as in ``random_cases.OF_RUN``."""
    return next((run for run in ("nightly", "long") if config.getoption(f"--{run}")), "normal")


def _is_normal(item: pytest.Item) -> bool:
    return _is_of_ci(item) and not item.get_closest_marker("long") and not of_long_run(*_name(item))


def _is_of_ci(item: pytest.Item) -> bool:
    return not of_nightly_run(*_name(item))


def _name(item: pytest.Item) -> tuple[str, str, str]:
    """File, test and variant."""
    test, _, variant = item.name.partition("[")
    return item.path.name, test, variant.removesuffix("]")


def pytest_collection_finish() -> None:
    """Exclude the objects made so far from every later garbage collection; seldom collect."""
    gc.freeze()
    gc.set_threshold(50_000, 20, 50)
    gc.enable()


def pytest_runtest_setup(item: pytest.Item) -> None:
    """End the browser before the first test without one: they come later."""
    if "browsing" in sys.modules and not item.get_closest_marker("browser"):
        sys.modules["browsing"].close_browser()


def pytest_sessionfinish() -> None:
    if "browsing" in sys.modules:
        sys.modules["browsing"].close_browser()


@pytest.fixture(scope="session", autouse=True)
def data_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Tests, and the servers they start, keep nothing in the user's own store."""
    folder = tmp_path_factory.mktemp("data")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JOINTID_DATA_DIR", str(folder))
        yield folder


@pytest.fixture(scope="session", autouse=True)
def quick_files() -> Iterator[None]:
    """Do not wait for the disk: no test cuts the power."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda _: None)
        yield


@pytest.fixture(scope="session", autouse=True)
def quick_app_tests() -> Iterator[None]:
    """Do once a session what AppTest does in every run, and start no processes for its computations.

    It compiles every page, asks a thousand times a second whether the page is complete, and copies the
    whole state of the session for every widget. Each of its runs counts as another person on the same
    server. It also reads the metadata of every installed package, where the app has no components.
    """
    from streamlit.components.v2 import manifest_scanner
    from streamlit.runtime.scriptrunner.script_cache import ScriptCache
    from streamlit.runtime.state.session_state import SessionState
    from streamlit.testing.v1 import local_script_runner

    from jointid.background.pool import Pool
    from jointid.ui.shared import results

    compiled = functools.cache(functools.partial(ScriptCache.get_bytecode, ScriptCache()))
    ask = local_script_runner.require_widgets_deltas

    def wait(runner: local_script_runner.LocalScriptRunner, timeout: float) -> None:
        runner._script_thread.join(timeout)
        ask(runner, 0.0 if runner._script_thread.is_alive() else 1.0)

    class State(Mapping[str, Any]):
        """The entries of a session, looked up one by one."""

        def __init__(self, state: SessionState) -> None:
            self.state = state

        def __getitem__(self, key: str) -> Any:
            return self.state[key]

        def __iter__(self) -> Iterator[str]:
            return iter(copied(self.state))

        def __len__(self) -> int:
            return len(copied(self.state))

    copied = SessionState.filtered_state.fget
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SessionState, "filtered_state", property(State))
        patch.setattr(manifest_scanner, "scan_component_manifests", list)
        patch.setattr(results, "_pool", functools.partial(Pool, 0))
        patch.setattr(ScriptCache, "get_bytecode", lambda _, path: compiled(path))
        patch.setattr(local_script_runner, "require_widgets_deltas", wait)
        yield


@pytest.fixture(scope="session", autouse=True)
def one_command() -> Iterator[None]:
    """Build the commands of a program once a session; typer's runner builds them for every call."""
    from typer import testing

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(testing, "_get_command", functools.cache(testing._get_command))
        yield


@pytest.fixture(scope="session", autouse=True)
def kept_analyses() -> Iterator[None]:
    """Analyse a study once a session: pages, commands and tests ask for the same ones."""
    from jointid import JointIdError, analysis
    from jointid.files.digest import study_digest

    analyse = analysis._analyse
    kept: dict[tuple[str, str], Analysis | JointIdError] = {}

    @functools.wraps(analyse)
    def once(study: Study, method: str, known: Analysis | None = None) -> Analysis:
        key = study_digest(study), method
        if key not in kept:
            try:
                kept[key] = analyse(study, method, known)
            except JointIdError as error:
                kept[key] = error
        found = kept[key]
        if isinstance(found, JointIdError):
            raise found.with_traceback(None)
        return replace(found, study=study)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(analysis, "_analyse", once)
        yield


@pytest.fixture
def analysed_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep no analysis: of tests that compare two of one study."""
    from jointid import analysis

    monkeypatch.setattr(analysis, "_analyse", analysis._analyse.__wrapped__)  # type: ignore[attr-defined]


@pytest.fixture(scope="session")
def reader() -> Iterator[ReaderProcess]:
    """A process that reads the logs of many tests; to begin one takes longer than to read a log."""
    from jointid.importing.read.reader_process import ReaderProcess

    class Kept(ReaderProcess):
        def close(self) -> None: ...

    reader = Kept()
    yield reader
    ReaderProcess.close(reader)


@pytest.fixture(autouse=True)
def one_reader(
    request: pytest.FixtureRequest, reader: ReaderProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Read logs in the process of the session, except in tests of the process itself."""
    if not request.node.get_closest_marker("own_reader"):
        monkeypatch.setattr("jointid.importing.read.logs.ReaderProcess", lambda: reader)


@pytest.fixture(autouse=True)
def main_module() -> Iterator[None]:
    """AppTest leaves its page behind as __main__, and processes that are spawned later would run it."""
    main = sys.modules["__main__"]
    yield
    sys.modules["__main__"] = main


@pytest.fixture(scope="session", autouse=True)
def valid_figures() -> Iterator[None]:
    """Every function that draws makes a valid figure: plotly checks its first one, the app none."""
    import plotly.graph_objects as go

    from jointid.figures.style import Sketch

    made, checked = Sketch.figure, set()

    @functools.wraps(made)
    def figure(*args: Any, **layout: Any) -> go.Figure:
        found = made(*args, **layout)
        code = sys._getframe(1).f_code
        if code not in checked:
            checked.add(code)
            go.Figure(found.to_dict())
        return found

    Sketch.figure = figure
    yield
    Sketch.figure = made


@pytest.fixture(scope="session")
def studies() -> dict[int, Study]:
    """Studies of one, two and three joints."""
    return {joints: simulated(joints) for joints in (1, 2, 3)}


@pytest.fixture(scope="session")
def analyses(studies: dict[int, Study]) -> dict[int, Analysis]:
    from jointid import analyse

    return {joints: analyse(study) for joints, study in studies.items()}


@pytest.fixture(scope="session")
def sample_folder(studies: dict[int, Study], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Sample folder: "paper" zipped, "one_joint" as a folder, "three_joints" zipped."""
    from jointid.files.study_files import save_study

    folder = tmp_path_factory.mktemp("sample_data")
    save_study(studies[2], folder / "paper.zip")
    save_study(studies[1], folder / "one_joint")
    save_study(studies[3], folder / "three_joints.zip", record_format="parquet")
    return folder


@pytest.fixture
def app(sample_folder: Path, monkeypatch: pytest.MonkeyPatch) -> AppTest:
    """The app beside the tests' samples, before its first run."""
    from app_pages import opened_app

    monkeypatch.setattr("jointid.ui.shared.workspace.SAMPLES", sample_folder)
    return opened_app()


@pytest.fixture
def jittered_log() -> bytes:
    """A log of one actuator at 1 Hz, some 100 Hz with jitter and a spring of 40 N·m/rad, unloaded."""
    import numpy as np

    rng = np.random.default_rng(5)
    time = np.arange(999) / 100.0 + rng.uniform(0, 0.7e-3, 999)
    position = 0.4 * np.sin(2 * np.pi * time - 1.2) + 0.06
    deflection = 1.3e-3 * np.sin(2 * np.pi * time + 0.4) + 1e-5 * rng.standard_normal(999)
    rows = np.column_stack([time, position, np.gradient(position, time), -40 * deflection, deflection])
    lines = [",".join(f"{value:.18e}" for value in row) for row in rows]
    return "\n".join(["t,position,velocity,effort,deflection", *lines, ""]).encode()


@pytest.fixture(scope="session")
def chromium() -> str:
    """Path of the browser; without one the test is skipped, or fails when one is required."""
    found = next(
        (
            path
            for name in ("chromium", "chromium-browser", "google-chrome")
            if (path := shutil.which(name))
        ),
        None,
    )
    if found is None:
        if os.environ.get("JOINTID_BROWSER") == "required":
            pytest.fail("JOINTID_BROWSER=required, but there is no chromium on the PATH.")
        pytest.skip("There is no chromium on the PATH.")
    return found


@pytest.fixture(scope="session")
def tree(sample_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the app, safe from edits during the tests, with the tests' sample studies."""
    from browsing import ROOT

    tree = tmp_path_factory.mktemp("app")
    shutil.copy2(ROOT / "app.py", tree)
    for name in ("pages", "jointid", ".streamlit", "docs/reference"):
        shutil.copytree(ROOT / name, tree / name)
    (tree / "sample_data").symlink_to(sample_folder)
    return tree


@pytest.fixture(scope="session")
def new_server(tree: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[], Server]:
    """Start a server with a store of its own; who starts it ends it."""
    from browsing import Server

    return lambda: Server(tree, tmp_path_factory.mktemp("store"))


@pytest.fixture
def server(new_server: Callable[[], Server]) -> Iterator[Server]:
    """An unused server, for one test."""
    server = new_server()
    yield server
    server.kill()


@pytest.fixture(scope="session")
def address(new_server: Callable[[], Server]) -> Iterator[str]:
    """Address of a server that tests share, with its cached results."""
    server = new_server()
    yield server.address
    server.kill()


@pytest.fixture(scope="module")
def browser(chromium: str) -> Browser:
    """The browser of all tests that this process runs; those who make contexts close them."""
    from browsing import kept_browser

    return kept_browser(chromium)


@pytest.fixture(scope="module")
def context(chromium: str) -> BrowserContext:
    """One for all tests that this process runs: the client's code is compiled once."""
    from browsing import kept_context

    return kept_context(chromium)


@pytest.fixture
def open_in(context: BrowserContext) -> Iterator[Callable[..., Page]]:
    """Open an address in a new tab; fail on errors and on requests to other machines."""
    from browsing import Watch, new_page

    watches: list[Watch] = []
    pages: list[Page] = []

    def open_address(url: str, *, width: int = 1440, height: int = 900, scheme: Any = None) -> Page:
        page = new_page(context)
        page.emulate_media(color_scheme=scheme)
        page.set_viewport_size({"width": width, "height": height})
        pages.append(page)
        watches.append(Watch(page))
        page.goto(url, wait_until="commit")
        return page

    yield open_address
    for page in pages:
        page.close()
    for watch in watches:
        watch.check()
