"""README and docs/: Python snippets run, all commands and options are listed, links have targets."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import pytest
from typer.main import get_command

import jointid
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


FUNCTIONS = [name for name in jointid.__all__ if inspect.isfunction(getattr(jointid, name))]
CLASSES = [name for name in jointid.__all__ if inspect.isclass(getattr(jointid, name))]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_public_functions_document_parameters_and_results(name: str) -> None:
    function = getattr(jointid, name)
    signature, text = inspect.signature(function), inspect.getdoc(function) or ""
    listed = re.findall(r"^([\w, ]+?)(?: : .*)?$", text.partition("Parameters\n---")[2], re.MULTILINE)
    documented = {each.strip() for line in listed for each in line.split(",")}
    assert set(signature.parameters) <= documented
    if signature.return_annotation not in (None, "None"):
        assert "\nReturns\n-------\n" in text


@pytest.mark.parametrize("name", CLASSES)
def test_public_classes_and_their_members_are_documented(name: str) -> None:
    public = getattr(jointid, name)
    assert inspect.getdoc(public)
    members = vars(public).items()
    for member, value in members:
        if not member.startswith("_") and isinstance(value, property | staticmethod | classmethod):
            assert inspect.getdoc(value), member
        if not member.startswith("_") and inspect.isfunction(value):
            assert inspect.getdoc(value), member


def test_the_reference_lists_every_public_name() -> None:
    listed = set(
        re.findall(r"^::: jointid\.(\w+)", (ROOT / "docs/reference/api.md").read_text("utf-8"), re.M)
    )
    assert listed == set(FUNCTIONS + CLASSES)
