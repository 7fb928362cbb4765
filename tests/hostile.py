"""Files whose every text contains markup for a picture, a link, a formula or bold, and its detection.

Nothing listens at the address, but a browser that reads one of these texts as markup requests it.
"""

from __future__ import annotations

import csv
import io
import json
import re
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from google.protobuf.message import Message
from markdown_it import MarkdownIt
from markdown_it.token import Token
from streamlit import dataframe_util

from jointid import Study
from jointid.arrays import Floats
from jointid.files.study_files import pack_study
from jointid.fleet.row import Row, failed_row
from jointid.fleet.table import to_parquet

AWAY = "127.0.0.1:9"
PIECES = {
    "qpic": f"![qpic](http://{AWAY}/pic.png)",
    "qfile": f"![qfile](&#47;&#47;{AWAY}&#47;file.png)",
    "qtag": f'<img src="http://{AWAY}/tag.png" alt=qtag>',
    "qlink": f"[qlink](http://{AWAY}/link)",
    "qanchor": f'<a href="http://{AWAY}/anchor">qanchor</a>',
    "qspan": f'<span style="fill:url(http://{AWAY}/f.svg#f);cursor:url(http://{AWAY}/c.cur)">qspan</span>',
    "qbold": "**qbold**",
    "qstrong": "<b>qstrong</b>",
    "qtex": "$qtex^2$",
    "bolt": ":material/bolt:",
    "qred": ":red[qred]",
    "qcode": "`qcode`",
    "qstrike": "~~qstrike~~",
    "qbare": f"http://{AWAY}/qbare",
}
"""What is written, by the word that stands alone once it was read as markup."""
ALL = " ".join(PIECES.values())
JOINER = "\N{WORD JOINER}"
READ = MarkdownIt("commonmark", {"html": True, "linkify": False}).enable(["table", "strikethrough"])


def piece(number: int) -> str:
    """One text of two pieces, another for every number."""
    known = list(PIECES.values())
    return f"{number} {known[number % len(known)]} {known[(number + 5) % len(known)]}"


def file_name(number: int) -> str:
    """A text without slashes, which a file can be called."""
    return f"{number} {PIECES['qfile']} {PIECES['qbold']} {PIECES['qtex']} {PIECES['qred']}"


# --- files


def hostile_study(study: Study) -> Study:
    """A study of two joints; some of its poses allow no transfer matrix, or only a part of one."""
    poses = {ALL: study.inertia, piece(2): study.inertia, piece(3): study.inertia}
    names = list(poses)
    pose_of = [names[0]] * 6 + [names[1]] * 5 + [names[2]] + [None] * len(study.records)
    records = [
        replace(record, label=f"{piece(k)}", pose=pose)
        for k, (record, pose) in enumerate(zip(study.records, pose_of, strict=False))
    ]
    return replace(study, records=records, poses=poses, name=ALL, description=ALL, robot=ALL)


def refused_study(study: Study) -> bytes:
    """A study's zip with names of tables and columns of its own, one of them without its torque."""
    packed = zipfile.ZipFile(io.BytesIO(pack_study(study)))
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as changed:
        toml = packed.read("study.toml").decode()
        for number, name in enumerate(n for n in packed.namelist() if n != "study.toml"):
            new = f"records/{file_name(number)}.csv"
            toml = toml.replace(f'"{name}"', json.dumps(new, ensure_ascii=False))
            text = packed.read(name).decode()
            changed.writestr(new, text.replace("tau_m1_Nm", "" + piece(0)) if number == 1 else text)
        changed.writestr("study.toml", toml)
    return buffer.getvalue()


def signals(phase: float) -> tuple[Floats, Floats, Floats]:
    """Time (s), angle (rad) and torque (N·m) of one joint: two sine runs with rests."""
    rng = np.random.default_rng(3)
    time = np.arange(0, 4.0, 4e-3)
    angle, torque = np.full(time.size, 0.2), np.zeros(time.size)
    for k, hertz in enumerate((5.0, 11.0)):
        inside = (time >= 2 * k + 0.2) & (time < 2 * k + 1.8)
        turn = 2 * np.pi * hertz * (time[inside] - 2 * k - 0.2) + phase
        angle[inside] += 0.05 * np.cos(turn)
        torque[inside] = -0.05 * 0.004 * (2 * np.pi * hertz) ** 2 * np.cos(turn)
    noise = rng.standard_normal((2, time.size))
    return time, angle + 2e-6 * noise[0], torque + 1e-4 * noise[1]


def hostile_logs() -> dict[str, bytes]:
    """Two logs of one joint each, recorded at once, and one of HDF5 with two tables."""
    import h5py

    logs = {}
    for joint in (1, 2):
        text = io.StringIO()
        rows = csv.writer(text)
        rows.writerow(
            [f"time {PIECES['qbold']} (s)", f"position {ALL} (rad)", f"torque {ALL} (Nm)", ALL]
        )
        rows.writerows([*row, ALL] for row in zip(*signals(0.7 * joint), strict=True))
        logs[f"axis{joint} {file_name(7)}.csv"] = text.getvalue().encode()
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        for number in (1, 2):
            group = file.create_group(f"{file_name(number)} {PIECES['qcode']}")
            for name, values, unit in zip(
                ("time", f"position {PIECES['qstrong']}", f"torque {PIECES['qspan'][:20]}"),
                signals(1.0 * number),
                ("s", "rad", ALL),
                strict=True,
            ):
                data = group.create_dataset(name.replace("/", "∕"), data=values[: 1000 - number])
                data.attrs["units"] = unit
    return logs | {f"{file_name(9)}.h5": buffer.getvalue()}


def hostile_toml() -> str:
    """Inertias of one joint with the name of the study and poses."""
    text = f"name = {json.dumps(ALL)}\n[inertia]\nM = [0.001]\nM2 = [[0.003]]\n"
    poses = (f"[poses.{json.dumps(piece(k))}]\nM2 = [[0.004]]\n" for k in (1, 2))
    return text + "".join(poses)


def hostile_fleet() -> bytes:
    """A table of results as ``jointid batch`` writes it."""
    rows = [
        Row(
            f"/cells/{piece(k)}/{file_name(k)}.zip", f"{k:032x}", "auto", ALL, 0.1,
            digest=f"{k:032x}", name=ALL, robot=piece(k % 3), date=f"2026-{1 + k:02d}-01", joints=1,
            records=3, K=(40.0 + 0.1 * (k % 5) + 30 * (k == 11),), D=(0.1,), K_error=(0.1,),
            D_error=(0.01,), misfit=1.0, verdict="warning", findings=(ALL, piece(k)),
        )
        for k in range(12)
    ]  # fmt: skip
    return to_parquet([*rows, failed_row(f"/cells/{ALL}.zip", "auto", "time", ALL)])


# --- what a page is sent


_MARKDOWN = {
    "body",
    "label",
    "help",
    "text",
    "title",
    "delta",
    "delta_description",
    "content",
    "captions",
}
"""Fields that streamlit's client reads as Markdown, of all messages but these."""
_NO_MARKDOWN = {"Html", "Json", "Code", "Text"}


def markup(message: Message) -> list[str]:
    """What an element or a block sends that would be read as markup, or would be shown changed."""
    found = []
    for text in _markdown_of(message):
        found += _misread(text)
    for text in _plotly_of(message):
        found += [
            text for word in PIECES if re.search(rf"<[^>]*>{word}", text) or f"alt={word}>" in text
        ]
    return found


def _messages(message: Message) -> Iterator[Message]:
    yield message
    for field, value in message.ListFields():
        if field.message_type is not None and not field.message_type.GetOptions().map_entry:
            for part in value if field.is_repeated else [value]:
                yield from _messages(part)


def _markdown_of(message: Message) -> Iterator[str]:
    for part in _messages(message):
        name = part.DESCRIPTOR.name
        if name == "Table":
            frame = dataframe_util.convert_arrow_bytes_to_pandas_df(part.arrow_data.data)  # type: ignore[attr-defined]
            yield from map(str, [*frame.columns, *frame.to_numpy().ravel()])
        if name in _NO_MARKDOWN:
            continue
        for field, value in part.ListFields():
            read = field.name in _MARKDOWN or (name, field.name) == ("Radio", "options")
            if read and field.type == field.TYPE_STRING:
                yield from value if field.is_repeated else [value]


def _plotly_of(message: Message) -> Iterator[str]:
    for part in _messages(message):
        if part.DESCRIPTOR.name == "PlotlyChart":
            yield from _strings(json.loads(part.spec))  # type: ignore[attr-defined]


def _strings(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for part in value.values() if isinstance(value, dict) else value:
            yield from _strings(part)


def _misread(markdown: str) -> list[str]:
    """What of a text is markup once a reader of Markdown has read it."""
    if not any(word in markdown for word in PIECES):
        return []
    # Streamlit's own marks, which the reader does not know.
    if re.search(r"(?<!\\)(:(red|material)|\$q)|http://|\bwww\.", markdown):
        return [markdown]
    tokens = READ.parse(markdown)
    if any(token.type.startswith("html") for token in _all(tokens)):
        return [markdown]
    texts = [token.content for token in _all(tokens) if token.type in ("text", "text_special")]
    shown = "".join(texts).replace(JOINER, "")
    return [f"{word}: {markdown}" for word in PIECES if _alone(word, shown)]


def _alone(word: str, shown: str) -> bool:
    """Whether a word stands without the mark before it; what follows it may be cut off."""
    mark = PIECES[word].rpartition(word)[0][-1]
    return re.search(rf"(?<!{re.escape(mark)}){word}", shown) is not None


def _all(tokens: list[Token]) -> Iterator[Token]:
    for token in tokens:
        yield token
        yield from _all(token.children or [])


# --- what a page shows


SHOWN = """
(words) => {
  const found = [], away = "127.0.0.1:9/";
  const walk = (root) => {
    for (const node of root.querySelectorAll("*")) {
      for (const name of ["src", "href", "xlink:href", "srcset", "data"]) {
        const value = node.getAttribute(name);
        if (value && (value.includes(away) || node[name]?.toString().includes(away)))
          found.push(node.outerHTML.slice(0, 200));
      }
      if ((node.getAttribute("style") || "").includes(away)) found.push(node.outerHTML.slice(0, 200));
      if (node.shadowRoot) walk(node.shadowRoot);
      for (const child of node.childNodes)
        if (child.nodeType === 3 && words.includes(child.data.trim()))
          found.push(node.outerHTML.slice(0, 200));
    }
  };
  walk(document);
  return found;
}
"""
"""Elements that a browser made of a piece: those that lead away, and words that stand alone."""
