"""The wheel and the sdist: package, app and samples are complete."""

from __future__ import annotations

import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from jointid.files.application import __version__

ROOT = Path(__file__).parents[1]


def built(what: str, source: Path, folder: Path) -> Path:
    """Build a wheel or an sdist of a source tree, with the tools that are installed here."""
    command = [sys.executable, "-m", "build", "--no-isolation", f"--{what}", "--outdir", str(folder)]
    run = subprocess.run([*command, str(source)], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    (made,) = folder.iterdir()
    return made


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built("wheel", ROOT, tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What an installation unpacks."""
    folder = tmp_path_factory.mktemp("site-packages")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    return folder


def files(folder: Path) -> set[Path]:
    return {
        file.relative_to(folder)
        for file in folder.rglob("*")
        if file.is_file() and "__pycache__" not in file.parts
    }


def test_the_wheel_holds_only_the_package_the_app_and_the_samples(installed: Path) -> None:
    app = {Path("app.py"), Path(".streamlit/config.toml"), Path("docs/reference/glossary.md")}
    app |= {"pages" / file for file in files(ROOT / "pages")}
    samples = files(ROOT / "sample_data") - {Path("make_samples.py"), Path("README.md")}
    app |= {"sample_data" / file for file in samples}
    expected = {"jointid" / file: ROOT / "jointid" / file for file in files(ROOT / "jointid")}
    expected |= {"jointid/app" / file: ROOT / file for file in app}
    about = Path(f"jointid-{__version__}.dist-info")
    assert {file for file in files(installed) if file.parts[0] != about.name} == expected.keys()
    assert all((installed / file).read_bytes() == own.read_bytes() for file, own in expected.items())
    assert f"\nVersion: {__version__}\n" in (installed / about / "METADATA").read_text("utf-8")


def test_an_installation_finds_its_app_and_samples(installed: Path, tmp_path: Path) -> None:
    program = (
        f"import sys; sys.path.insert(0, {str(installed)!r});"
        "from jointid.files.application import application_folder, sample_studies;"
        "print(application_folder(), *sample_studies().values(), sep='\\n')"
    )
    run = subprocess.run(
        [sys.executable, "-P", "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    app = installed / "jointid" / "app"
    names = ["paper.zip", "exercise_1.zip", "exercise_2.zip", "manutec_r3.zip", "motions.zip"]
    names += ["single_joint", "six_axes.zip", "worn_cell.zip"]
    assert run.stdout.splitlines() == [str(app), *(str(app / "sample_data" / name) for name in names)]


def test_the_sdist_makes_the_same_wheel(wheel: Path, tmp_path: Path) -> None:
    sdist = built("sdist", ROOT, tmp_path / "sdist")
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path, filter="data")
    again = built("wheel", tmp_path / f"jointid-{__version__}", tmp_path / "wheel")
    assert again.read_bytes() == wheel.read_bytes()
