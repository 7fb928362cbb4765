"""Text from files and users is shown literally: no picture, link, formula or colour."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from markdown_it import MarkdownIt
from streamlit.testing.v1 import AppTest

from jointid import load_study
from jointid.files.digest import study_digest
from jointid.files.store import Store, new_workspace
from jointid.files.store_files import user_folder
from jointid.files.study_files import pack_study
from jointid.ui.shared.messages import markdown_escape

ROOT = Path(__file__).parents[1]
HOSTILE = (
    "![a](http://10.9.8.7/x.png) [l](http://10.9.8.7/) **b** `c` <b>d</b> $e$ :red[f] :material/home:"
)
READ = MarkdownIt("commonmark", {"html": True, "linkify": False}).enable(["table", "strikethrough"])
JOINER = "\N{WORD JOINER}"


def shown(markdown: str) -> str:
    """Text that a Markdown reader shows; fails when it would be more than plain paragraphs."""
    lines = []
    for token in READ.parse(markdown):
        assert token.type in ("paragraph_open", "inline", "paragraph_close"), token
        for part in token.children or []:
            assert part.type in ("text", "text_special", "hardbreak", "softbreak"), part
            lines.append("\n" if part.type.endswith("break") else part.content)
    return "".join(lines).replace(JOINER, "")


@given(st.text(st.characters(codec="utf-8", categories=("L", "N", "P", "S", "Zs")), max_size=60))
def test_escaped_text_has_no_markup(text: str) -> None:
    assert shown(markdown_escape(text)) == "\n".join(
        x for line in text.splitlines() if (x := line.strip())
    )


@pytest.mark.parametrize("text", [HOSTILE, "# a", "1. b", "- c", "> d", "| a |\n| - |\n| b |", "~~x~~"])
def test_marks_are_shown(text: str) -> None:
    assert shown(markdown_escape(text)) == text


def test_text_without_markup_is_unchanged() -> None:
    for text in ("theta_m1_rad is 3.2 N·m (±2 %)", "Check M and M2: 1e-3 kg·m²", "C:/logs/a_b.csv"):
        assert markdown_escape(text) == text


def test_directives_and_bare_addresses_are_broken_up() -> None:
    """Streamlit's own marks, which the reader above does not know."""
    text = markdown_escape(HOSTILE + " http://10.9.8.7 www.x.org")
    assert not re.search(r"(?<!\\):(red|material)", text)
    assert "http://" not in text
    assert "www." not in text


def test_a_hostile_study_is_shown_literally(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("JOINTID_DATA_DIR", str(tmp_path))
    study = load_study(ROOT / "sample_data" / "single_joint")
    study = replace(study, name=HOSTILE, description=HOSTILE)
    place = new_workspace()
    entry = Store(user_folder()).put(place, f"{HOSTILE}.zip", study_digest(study), pack_study(study))
    page = AppTest.from_file(str(ROOT / "app.py"), default_timeout=60)
    page.query_params["w"], page.query_params["study"] = place, entry.digest
    page.run()
    assert not page.exception
    assert shown(page.title[0].value) == HOSTILE
    for text in [*page.caption, *page.markdown, *page.error, *page.warning, *page.info, *page.success]:
        assert "http://10" not in text.value, text.value


SHOWING = re.compile(
    "markdown|write|caption|info|warning|error|success|title|(sub)?header|progress|spinner|status|toast"
    "|expander|popover|(download_|link_)?button|checkbox|toggle|metric|(multi)?select(box)?|radio|pills"
    "|(text|number)_input|text_area|file_uploader|segmented_control|slider|page_link"
)
"""Calls of streamlit that read their first arguments as Markdown."""
FOREIGN = re.compile(
    "labels|poses?|files?|log|columns|description|notes?|error|problems?|message|detail|remedy|rejected"
    "|transfer_problem"
)
"""What texts from files, and messages that quote them, are called in the package."""


def unescaped(node: ast.AST) -> Iterator[str]:
    """What an expression names that may hold anything, but for the arguments of the escape."""
    if isinstance(node, ast.Call) and ast.unparse(node.func) in ("markdown_escape", "counted", "len"):
        return
    if isinstance(node, ast.Name | ast.Attribute):
        name = node.id if isinstance(node, ast.Name) else node.attr
        if FOREIGN.fullmatch(name):
            yield name
    for child in ast.iter_child_nodes(node):
        yield from unescaped(child)


def test_foreign_texts_reach_streamlit_through_the_escape_only() -> None:
    """A message names files, columns and keys, which may hold anything."""
    wrong = []
    for file in [*(ROOT / "jointid" / "ui").rglob("*.py"), *ROOT.glob("pages/*.py"), ROOT / "app.py"]:
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
                continue
            named = [word.value for word in node.keywords if word.arg in ("label", "help", "text")]
            if SHOWING.fullmatch(node.func.attr):
                first = node.args[: 2 if node.func.attr == "progress" else 1]
                for part in [*first, *named]:
                    wrong += [f"{file.name}:{node.lineno} {name}" for name in unescaped(part)]
            is_table = ast.unparse(node.func) == "st.table"  # whose cells are Markdown, too
            if is_table and ast.unparse(node.args[0]) != "escaped":
                wrong.append(f"{file.name}:{node.lineno} show_text_table shows any text")
    assert wrong == []
