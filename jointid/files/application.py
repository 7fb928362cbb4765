"""Version; folder of the app, its pages and sample studies, in a checkout or an installed package."""

from importlib.resources import files
from pathlib import Path

__version__ = "0.2.0"
"""Written here once: the build, the command line, results and workers read it."""


def application_folder() -> Path:
    """Return the folder of app.py, pages/, sample_data/ and .streamlit/.

    It is ``jointid/app/``, where the wheel has them (see pyproject.toml), else the root of the checkout.
    """
    package = Path(str(files("jointid")))
    packaged = package / "app"
    return packaged if packaged.is_dir() else package.parent


def sample_studies(folder: Path | None = None) -> dict[str, Path]:
    """Return the sample studies by name, file or folder without suffix, the paper's first.

    They are in ``folder``, by default ``sample_data/`` of the app; none without the folder.
    """
    folder = folder or application_folder() / "sample_data"
    found: dict[str, Path] = {}
    for path in sorted(folder.iterdir()) if folder.is_dir() else []:
        if path.suffix == ".zip" or (path / "study.toml").is_file():
            found.setdefault(path.stem, path)
    return dict(sorted(found.items(), key=lambda item: item[0] != "paper"))
