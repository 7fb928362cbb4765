"""README and docs/: Python snippets run, all commands are listed, links have targets."""

from __future__ import annotations

import inspect
import json
import re
import runpy
import shlex
import shutil
import struct
from collections.abc import Iterator
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType
from typing import Any

import numpy as np
import pytest
from typer.main import get_command
from typer.testing import CliRunner

import jointid
from jointid.cli import app

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
SNIPPET = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
WITH_CODE = [page for page in PAGES if SNIPPET.search(page.read_text("utf-8"))]
QUICK = ("README.md", "docs/how-to/robot-model.md")
"""Pages whose snippets a normal run tries."""


def name(page: Path) -> str:
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, id=name(page), marks=() if name(page) in QUICK else pytest.mark.long)
        for page in WITH_CODE
    ],
)
def test_snippets_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In order, in one namespace, in a folder with only the samples."""
    (tmp_path / "sample_data").symlink_to(ROOT / "sample_data")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for code in SNIPPET.findall(page.read_text("utf-8")):
        exec(compile(code, name(page), "exec"), names)


SHELL = re.compile(r"^```bash\n(.*?)^```", re.MULTILINE | re.DOTALL)
WITH_COMMANDS = [
    page
    for page in PAGES
    if re.search(r"^jointid (?!app)", "".join(SHELL.findall(page.read_text("utf-8"))), re.MULTILINE)
]


def edit_mapping(path: Path) -> None:
    """The corrections of the tutorial: gear ratios, rated torques, held torque, all confirmed."""
    mapping = json.loads(path.read_text("utf-8"))
    for joint, ratio, rated in zip(mapping["joints"], (101.0, -93.5), (8.2, 2.1), strict=True):
        joint["gear_ratio"], joint["torque"]["scale"] = ratio, rated
    path.write_text(json.dumps(mapping | {"torque_hold": True, "assumed": []}), "utf-8")


@pytest.fixture(scope="module")
def example_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log that an example writes, once for all pages."""
    folder = tmp_path_factory.mktemp("log")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        runpy.run_path(str(ROOT / "examples" / "twincat_log.py"), run_name="__main__")
    return folder / "cell7.csv"


@pytest.mark.long
@pytest.mark.parametrize("page", WITH_COMMANDS, ids=name)
def test_commands_run(
    page: Path, example_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In order, with the log of the example, the TOML of the tutorials and a folder of studies."""
    monkeypatch.chdir(tmp_path)
    for copy in ("cell7.csv", "log.csv"):
        shutil.copy(example_log, copy)
    shutil.copytree(ROOT / "sample_data" / "single_joint", "cells/one")
    for source, target in (("tutorials/own-robot", "inertia.toml"), ("how-to/plan", "cell7.toml")):
        text = (ROOT / "docs" / f"{source}.md").read_text("utf-8")
        Path(target).write_text(re.findall(r"^```toml\n(.*?)^```", text, re.M | re.S)[0], "utf-8")
    lines = [line for block in SHELL.findall(page.read_text("utf-8")) for line in block.splitlines()]
    for line in lines:
        command = shlex.split(line, comments=True)
        if command[:1] == ["jointid"] and command[1] != "app":
            result = CliRunner().invoke(app, command[1:])
            assert result.exit_code == 0, (line, result.output, result.exception)
        if "--guess" in command:
            edit_mapping(Path("columns.json"))


def test_every_command_is_listed_and_every_option_explained() -> None:
    rows = (ROOT / "docs" / "reference" / "command-line.md").read_text("utf-8").splitlines()
    commands = get_command(app).commands  # type: ignore[attr-defined]
    listed = [found[1] for row in rows if (found := re.match(r"\| `jointid ([\w-]+)", row))]
    assert listed == list(commands)
    for command, found in commands.items():
        for option in found.params:
            assert option.help or getattr(option, "hidden", False), (command, option.name)


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_links_have_targets(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text("utf-8")):
        if "://" not in target:
            assert (page.parent / target).exists(), target


def test_functions_and_packages_named_on_the_code_page_exist() -> None:
    text = (ROOT / "docs" / "explanation" / "code.md").read_text("utf-8")
    steps = re.findall(r"(\w+\.py) {2,}(\w+)\(", text)
    assert len(steps) > 4
    for name, function in steps:
        found = [file.read_text("utf-8") for file in (ROOT / "jointid").rglob(name)]
        assert any(f"\ndef {function}(" in code for code in found), function
    package = (ROOT / "jointid").iterdir()
    rooms = {path.name for path in package if path.suffix == ".py" or (path / "__init__.py").exists()}
    listed = set(re.findall(r"[`/](\w+(?:\.py)?)/?`", text))
    assert rooms - {"__init__.py"} <= listed


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


def _texts() -> str:
    """All texts of the package, apart at every value in them; as the interpreter keeps them compiled."""

    def of(code: CodeType) -> Iterator[str]:
        for constant in code.co_consts:
            if isinstance(constant, CodeType):
                yield from of(constant)
            elif isinstance(constant, str | tuple):
                yield from [constant] if isinstance(constant, str) else map(str, constant)

    files = sorted((ROOT / "jointid").rglob("*.py"))
    codes = (SourceFileLoader(path.stem, str(path)).get_code(path.stem) for path in files)
    return "\n".join(text for code in codes if code is not None for text in of(code))


def test_the_listed_errors_exist() -> None:
    rows = (ROOT / "docs/reference/errors.md").read_text("utf-8").splitlines()
    messages = [row.split(" | ")[1] for row in rows if row.startswith("| ") and "---" not in row][1:]
    texts = _texts()
    fragments = [part.strip(" :,.?") for message in messages for part in re.split("[…;]", message)]
    assert len(messages) > 15
    for fragment in fragments:
        assert fragment in texts, fragment


def test_the_example_reader_in_contributing_reads_its_format(tmp_path: Path) -> None:
    names: dict[str, Any] = {}
    exec(SNIPPET.findall((ROOT / "CONTRIBUTING.md").read_text("utf-8"))[0], names)
    heads = [
        struct.pack("<32s8s", name.encode(), unit.encode())
        for name, unit in (("q", "deg"), ("tau", "%"))
    ]
    values = np.arange(20, dtype="<f4")
    log = b"PLANT7" + struct.pack("<dII", 500.0, 2, 10) + b"".join(heads) + values.tobytes()
    path = tmp_path / "run.p7"
    path.write_bytes(log)
    (table,) = names["READER"].read("run.p7", str(path))
    assert (table.column("q").unit, table.column("tau").unit) == ("deg", "%")
    assert table.column("time").values[-1] == pytest.approx(9 / 500)
    assert table.column("tau").values.tolist() == values[1::2].tolist()
    assert names["READER"].recognises(log[:4096])
    path.write_bytes(log[:-1])
    with pytest.raises(jointid.JointIdError, match="cut short"):
        names["READER"].read("run.p7", str(path))


def test_the_example_text_reader_in_contributing_reads_its_format(tmp_path: Path) -> None:
    names: dict[str, Any] = {}
    for code in SNIPPET.findall((ROOT / "CONTRIBUTING.md").read_text("utf-8")):
        exec(code, names)
    path = tmp_path / "run.txt"
    path.write_bytes(b"PLANT8 500 Hz\r\nq;tau\r\n1.5;-2\r\n2.5;3\r\n")
    (table,) = names["TEXT_READER"].read("run.txt", str(path))
    assert table.column("time").values.tolist() == [0.0, 1 / 500]
    assert table.column("q").values.tolist() == [1.5, 2.5]
    assert table.column("tau").values.tolist() == [-2.0, 3.0]
    assert names["TEXT_READER"].recognises(path.read_bytes())
    path.write_bytes(b"PLANT8 500 Hz\nq;tau\n1.5;-2\n2.5;3\n3.")
    (cut,) = names["TEXT_READER"].read("run.txt", str(path))
    assert cut.column("q").values.tolist() == [1.5, 2.5]
    assert "The last line (5) is cut short and was left out." in cut.notes
