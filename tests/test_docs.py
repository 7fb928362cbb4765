"""README and docs/: Python snippets run, all commands and options are listed, links have targets."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from typer.main import get_command

from jointid.cli import app

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
SNIPPET = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
WITH_CODE = [page for page in PAGES if SNIPPET.search(page.read_text("utf-8"))]
LONG = ("docs/tutorials/six-axes.md", "docs/how-to/simulate.md", "docs/tutorials/motion.md")
"""Pages whose analyses take more than a second."""


def name(page: Path) -> str:
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, id=name(page), marks=pytest.mark.long if name(page) in LONG else ())
        for page in WITH_CODE
    ],
)
def test_snippets_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In order, in one namespace, in a folder that holds nothing but the samples."""
    (tmp_path / "sample_data").symlink_to(ROOT / "sample_data")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for code in SNIPPET.findall(page.read_text("utf-8")):
        exec(compile(code, name(page), "exec"), names)


def test_every_command_and_option_is_listed() -> None:
    rows = (ROOT / "docs" / "reference" / "command-line.md").read_text("utf-8").splitlines()
    for command, found in get_command(app).commands.items():  # type: ignore[attr-defined]
        row = next(row for row in rows if row.startswith(f"| `jointid {command}"))
        written = {max(p.opts, key=len) for p in found.params if p.param_type_name == "option"}
        written |= {max(p.secondary_opts, key=len) for p in found.params if p.secondary_opts}
        assert written - {"--help"} == set(re.findall(r"`(--[\w-]+)`", row)), command


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_links_have_targets(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text("utf-8")):
        if "://" not in target:
            assert (page.parent / target).exists(), target


def test_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text("utf-8").splitlines()) <= 120
