"""Logs and studies that refer to files of the server: the attacks that each format allows.

The files of the server hold one word and one number that no attack contains.
"""

from __future__ import annotations

import base64
import io
import pickle
import re
import shutil
import sqlite3
import stat
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import openpyxl
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet as pq  # type: ignore[import-untyped]
import pytest
from log_makers import ANGLE, ROWS, TIME_S, TORQUE, ros_bag, zipped
from streamlit.testing.v1 import AppTest
from typer.testing import CliRunner

from jointid import JointIdError, load_study
from jointid.cli import app
from jointid.files.study_files import lines_around
from jointid.importing import read_log, read_logs
from jointid.importing.read.readers import readers
from jointid.ui.shared import workspace

APP = Path(__file__).parents[1] / "app.py"

WORD = "swordfish"
NUMBER = 4242.4242
BLOSC = 32_001
"""Blosc's number in the register of HDF5 filters: not part of HDF5 itself."""


class Server:
    """Files on the server that an upload must not read.

    Parameters
    ----------
    folder : Path
        Where to make them; its path has no character that a URI would escape.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        secret = np.full(ROWS, NUMBER)
        self.raw, self.text, self.hdf5 = folder / "s.bin", folder / "s.txt", folder / "s.h5"
        self.raw.write_bytes(secret.tobytes())
        self.text.write_text(WORD * ROWS)
        self.xml = folder / "s.xml"
        self.xml.write_text(f"<t>{WORD}</t>")
        with h5py.File(self.hdf5, "w") as file:
            for name in ("data", "group/time", "group/torque", "values"):
                file[name] = secret
                file[name].attrs["units"] = WORD
            file["label"] = np.frombuffer(WORD.encode(), np.uint8)
        self.parquet, self.csv = folder / "s.parquet", folder / "s.csv"
        pq.write_table(pa.table({"t": TIME_S, WORD: secret}), self.parquet)
        self.csv.write_text(f"t,{WORD}\n" + "".join(f"{t},{NUMBER}\n" for t in TIME_S))
        self.bag = secret_bag(folder)

    def climb(self, separator: str = "/") -> str:
        """Way from any folder up to the root."""
        return f"..{separator}" * 12


def secret_bag(folder: Path) -> Path:
    """Bag of ROS 2 (SQLite) whose joint has the word as its name and the number as its torque."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    state, header, stamp = (
        store.types[name]
        for name in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    path = folder / "bag"
    with Writer(path, version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/joint_states", state.__msgtype__, typestore=store)
        for k in range(ROWS):
            message = state(
                header=header(stamp=stamp(1, 2_000_000 * k), frame_id=""),
                name=[WORD],
                position=np.array([ANGLE[k]]),
                velocity=np.array([]),
                effort=np.array([NUMBER]),
            )
            writer.write(connection, 2_000_000 * k, store.serialize_cdr(message, state.__msgtype__))
    return path / "bag.db3"


# --- HDF5 and MATLAB 7.3

Fill = Callable[[h5py.File, Server], None]


def hdf5_with(fill: Fill, server: Server, **options: Any) -> bytes:
    """An HDF5 file with a time and an angle, and what an attack adds."""
    path = server.folder / "made.h5"
    with h5py.File(path, "w", **options) as file:
        file["time"], file["position"] = TIME_S, ANGLE
        fill(file, server)
    return path.read_bytes()


def matlab_with(fill: Fill, server: Server) -> bytes:
    """The same as MATLAB's version 7.3: behind a text."""

    def filled(file: h5py.File, server: Server) -> None:
        for name in ("time", "position"):
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
        fill(file, server)

    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    return head + hdf5_with(filled, server, userblock_size=512)[len(head) :]


def external(group: h5py.Group, name: str, file: Path, kind: Any = np.float64) -> None:
    """Add a dataset whose bytes are those of another file."""
    size = file.stat().st_size // np.dtype(kind).itemsize
    size = min(size, ROWS)
    group.create_dataset(name, (size,), kind, external=[(str(file), 0, size * np.dtype(kind).itemsize)])


def link(group: h5py.Group, name: str | bytes, server: Server, target: str) -> None:
    """Add a link to an object of another file."""
    group[name] = h5py.ExternalLink(str(server.hdf5), target)


def virtual(group: h5py.Group, name: str, file: str, source: str, stop: int | None = ROWS) -> None:
    """Add a virtual dataset."""
    layout = h5py.VirtualLayout((ROWS,), np.float64, maxshape=(stop,))
    layout[:] = h5py.VirtualSource(file, source, (ROWS,), maxshape=(stop,))
    group.create_virtual_dataset(name, layout)


def scope(file: h5py.File, server: Server, **secret: str) -> h5py.Group:
    """A structure of a Simulink scope; parts in ``secret`` are links to the server's file."""
    group = file.create_group("Scope")
    signals = group if "signals" in secret else group.create_group("signals")
    own = {"time": TIME_S, "values": np.vstack([TORQUE, ANGLE]), "label": np.array([116], np.uint16)}
    for part, values in own.items():
        place = group if part == "time" else signals
        if part not in secret and ("signals" not in secret or part == "time"):
            place[part] = values
    for part, target in secret.items():
        place = group if part in ("time", "signals") else signals
        link(place, part, server, target)
    return group


def by_reference(file: h5py.File, server: Server) -> None:
    """An array of structs: each field is a reference to a dataset elsewhere."""
    hidden = file.create_group("#refs#")
    external(hidden, "v", server.raw)
    external(hidden, "l", server.text, np.uint8)
    group = scope(file, server)
    del group["signals"]["values"], group["signals"]["label"]
    for part, target in (("values", "v"), ("label", "l")):
        references = np.array([hidden[target].ref], dtype=h5py.ref_dtype)
        group["signals"].create_dataset(part, data=references, dtype=h5py.ref_dtype)


def scope_virtual_references(file: h5py.File, server: Server) -> None:
    """References that themselves come from another file."""
    group = scope(file, server)
    del group["signals"]["values"]
    layout = h5py.VirtualLayout((1,), h5py.ref_dtype)
    layout[:] = h5py.VirtualSource(str(server.hdf5), "refs", (1,))
    group["signals"].create_virtual_dataset("values", layout)


def through_soft_links(file: h5py.File, server: Server) -> None:
    """A soft link leads to an external one that the reader does not come by itself."""
    hidden = file.create_group("#refs#")
    link(hidden, "x", server, "/")
    file["torque"] = h5py.SoftLink("/#refs#/x/data")
    group = file.create_group("Scope")
    group["time"] = TIME_S
    group["signals"] = h5py.SoftLink("/#refs#/x")


def chained(file: h5py.File, server: Server) -> None:
    """A virtual dataset of this very file, of one that is too deep to be read by itself."""
    deep = file.create_group("/".join("abcdefghijkl"))
    external(deep, "x", server.raw)
    virtual(file, "torque", ".", deep.name + "/x")


def scales(file: h5py.File, server: Server) -> None:
    """A dimension scale in another file, out of the reader's way."""
    hidden = file.create_group("#refs#")
    external(hidden, "scale", server.raw)
    hidden["scale"].make_scale(WORD[::-1])
    file["position"].dims[0].attach_scale(hidden["scale"])
    file["torque"] = TORQUE
    file["torque"].attrs["units"] = file["position"].regionref[:8]
    file["torque"].attrs["columns"] = np.array([hidden["scale"].ref], dtype=h5py.ref_dtype)
    regions = np.array([hidden["scale"].regionref[:8]], dtype=h5py.regionref_dtype)
    file.create_dataset("regions", data=regions, dtype=h5py.regionref_dtype)


def foreign_filter(file: h5py.File, server: Server) -> None:
    """Chunks of a filter that HDF5 would load as a plugin."""
    create = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    create.set_chunk((ROWS,))
    create.set_filter(BLOSC, h5py.h5z.FLAG_OPTIONAL)
    space = h5py.h5s.create_simple((ROWS,))
    made = h5py.h5d.create(file.id, b"torque", h5py.h5t.IEEE_F64LE, space, create)
    made.write_direct_chunk((0,), TORQUE.tobytes())


def compound_external(file: h5py.File, server: Server) -> None:
    """A table whose rows lie in another file."""
    external(file.create_group("log"), "run", server.raw, [("a", "f8"), ("b", "f8")])


HDF5: dict[str, tuple[Fill, str]] = {
    "external storage": (lambda f, s: external(f, "torque", s.raw), "external"),
    "external text": (lambda f, s: external(f, "torque", s.text, np.uint8), "external"),
    "external, nested": (lambda f, s: external(f, "a/b/torque", s.raw), "external"),
    "external table": (compound_external, "external"),
    "virtual": (lambda f, s: virtual(f, "torque", str(s.hdf5), "data"), "virtual"),
    "virtual, unlimited": (lambda f, s: virtual(f, "torque", str(s.hdf5), "data", None), "virtual"),
    "virtual, pattern": (lambda f, s: virtual(f, "torque", f"{s.folder}/s%%b.h5", "data"), "virtual"),
    "virtual, this file": (lambda f, s: virtual(f, "torque", ".", "position"), "virtual"),
    "virtual, chained": (chained, "virtual"),
    "link": (lambda f, s: link(f, "torque", s, "data"), "link"),
    "link to a group": (lambda f, s: link(f, "g", s, "group"), "link"),
    "link to nothing": (lambda f, s: f.__setitem__("g", h5py.ExternalLink("/none.h5", "x")), "link"),
    "link, no UTF-8": (lambda f, s: link(f, b"\xff", s, "data"), "cannot be read"),
    "soft links": (through_soft_links, ""),
    "scope, time": (lambda f, s: void(scope(f, s, time="data")), "link"),
    "scope, signals": (lambda f, s: void(scope(f, s, signals="/")), "link"),
    "scope, values": (lambda f, s: void(scope(f, s, values="data")), "link"),
    "scope, label": (lambda f, s: void(scope(f, s, label="label")), "link"),
    "references": (by_reference, "external"),
    "virtual references": (scope_virtual_references, "virtual"),
    "scales, regions": (scales, ""),
    "filter": (foreign_filter, "filter"),
}


def user_defined_link(server: Server) -> bytes:
    """A link of a type that only its program knows."""
    made = hdf5_with(lambda file, s: link(file, "mine", s, "data"), server)
    assert b"\x40\x04mine" in made  # type and length of the name
    return made.replace(b"\x40\x04mine", b"\x41\x04mine")


def void(_: object) -> None:
    """Make an expression a statement."""


# --- Bags of ROS


def bag_with(server: Server, kind: str, change: Callable[[dict[str, bytes]], dict[str, bytes]]) -> bytes:
    """A zipped bag, changed."""
    folder = server.folder / "own"
    folder.mkdir(exist_ok=True)
    path = folder / f"bag_{kind}_True"
    path = path if path.is_dir() else ros_bag(folder, kind)
    return zipped(change({file.name: file.read_bytes() for file in path.iterdir()}))


def naming(target: str, *, there: str = "") -> Callable[[dict[str, bytes]], dict[str, bytes]]:
    """Have metadata.yaml name another file, one called ``there`` beside it or none."""

    def change(files: dict[str, bytes]) -> dict[str, bytes]:
        own = next(name for name in files if name != "metadata.yaml")
        described = files["metadata.yaml"].replace(own.encode(), target.encode())
        return {"metadata.yaml": described, there or own: files[own]}

    return change


def escaped(server: Server, ending: str = "") -> Callable[[dict[str, bytes]], dict[str, bytes]]:
    """A file whose name, taken as part of a URI, is the way to another one."""
    name = (server.climb() + str(server.bag)[1:]).replace("/", "%2f") + ending
    return naming(name, there=name)


def compressed(files: dict[str, bytes]) -> dict[str, bytes]:
    """Say that the files are compressed, whatever they are."""
    described = files["metadata.yaml"].replace(b"compression_format: ''", b"compression_format: zstd")
    described = described.replace(b"compression_mode: ''", b"compression_mode: file")
    assert described != files["metadata.yaml"]
    packed = {n: pa.compress(d, "zstd", asbytes=True) for n, d in files.items() if n != "metadata.yaml"}
    return packed | {"metadata.yaml": described}


def yaml_with(text: str) -> Callable[[dict[str, bytes]], dict[str, bytes]]:
    """Put a tag of YAML's where the name of a topic is expected."""

    def change(files: dict[str, bytes]) -> dict[str, bytes]:
        described = files["metadata.yaml"].replace(b"/joint_states", text.encode())
        assert described != files["metadata.yaml"]
        return files | {"metadata.yaml": described}

    return change


def database_with(server: Server, *statements: str) -> bytes:
    """A bag's database whose messages come from elsewhere."""
    path = server.folder / "made.db3"
    path.unlink(missing_ok=True)
    path.write_bytes(server.bag.read_bytes())
    with sqlite3.connect(path) as database:
        database.execute("DELETE FROM messages")
        database.execute("UPDATE topics SET name = '/joint_states'")
        for statement in statements:
            database.execute(statement)
    database.close()
    return path.read_bytes().replace(WORD.encode(), b"x" * len(WORD))


def view(source: str) -> tuple[str, str]:
    """The messages as a view."""
    return (
        "ALTER TABLE messages RENAME TO kept",
        f"CREATE VIEW messages AS SELECT 1 AS id, 1 AS topic_id, 1 AS timestamp, {source} AS data",
    )


def virtual_table(module: str) -> tuple[str, ...]:
    """The messages as a table of a module, whether this SQLite has it or not."""
    return (
        "ALTER TABLE messages RENAME TO kept",
        "PRAGMA writable_schema = ON",
        "INSERT INTO sqlite_master VALUES ('table', 'messages', 'messages', 0, "
        f"'CREATE VIRTUAL TABLE messages USING {module}')",
    )


# --- Parquet, Excel, MATLAB 5


def parquet_elsewhere(server: Server) -> bytes:
    """Parquet whose column chunks are said to lie in another file."""
    path = server.folder / "made.parquet"
    collected: list[Any] = []
    table = pa.table({"t": TIME_S, "position": ANGLE, "torque": TORQUE})
    pq.write_table(table, path, metadata_collector=collected)
    collected[0].set_file_path(str(server.parquet))
    data = path.read_bytes()
    footer = int.from_bytes(data[-8:-4], "little") + 8
    collected[0].write_metadata_file(str(path))
    return data[:-footer] + path.read_bytes()[len(b"PAR1") :]


class _Reads:
    """Object that reads a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> Any:
        return exec, (f"raise ValueError(open({str(self.path)!r}).read())",)


def parquet_pickled(server: Server) -> bytes:
    """Parquet with an extension type, and an index of pandas, that are pickles."""
    pickled = pickle.dumps(_Reads(server.text))
    extension = {
        b"ARROW:extension:name": b"arrow.py_extension_type",
        b"ARROW:extension:metadata": pickled,
    }
    fields = [pa.field("t", pa.float64(), metadata=extension), pa.field("torque", pa.float64())]
    fields.append(pa.field("position", pa.float64()))
    meta = {b"pandas": base64.b64encode(pickled), b"PANDAS_ATTRS": pickled}
    table = pa.table([TIME_S, TORQUE, ANGLE], schema=pa.schema(fields, metadata=meta))
    buffer = io.BytesIO()
    pq.write_table(table, buffer)
    return buffer.getvalue()


def workbook(server: Server, edit: Callable[[dict[str, bytes]], dict[str, bytes]]) -> bytes:
    """A workbook, changed."""
    book = openpyxl.Workbook()
    book.active.append(["t", "position", "torque"])
    for row in zip(TIME_S[:50], ANGLE[:50], TORQUE[:50], strict=True):
        book.active.append([float(value) for value in row])
    buffer = io.BytesIO()
    book.save(buffer)
    with zipfile.ZipFile(buffer) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    return zipped(edit(files))


def replacing(part: str, *edits: tuple[str, str]) -> Callable[[dict[str, bytes]], dict[str, bytes]]:
    """Replace text in one part of a workbook."""

    def change(files: dict[str, bytes]) -> dict[str, bytes]:
        text = files[part].decode()
        for old, new in edits:
            assert old in text, (part, old, text[:500])
            text = text.replace(old, new, 1)
        return files | {part: text.encode()}

    return change


SHEET = "xl/worksheets/sheet1.xml"


def entity(target: str) -> Callable[[dict[str, bytes]], dict[str, bytes]]:
    """An XML entity in place of a cell's value."""
    document = f'<!DOCTYPE worksheet [<!ENTITY e SYSTEM "{target}">]><worksheet'
    cell = '<c r="D1" t="inlineStr"><is><t>&e;</t></is></c></row>'
    return replacing(SHEET, ("<worksheet", document), ("</row>", cell))


def many_laughs() -> Callable[[dict[str, bytes]], dict[str, bytes]]:
    """XML entities that expand to a billion letters."""
    entities = ['<!ENTITY e0 "ha">']
    entities += [f'<!ENTITY e{k} "{f"&e{k - 1};" * 10}">' for k in range(1, 10)]
    document = f"<!DOCTYPE worksheet [{''.join(entities)}]><worksheet"
    cell = '<c r="D1" t="inlineStr"><is><t>&e9;</t></is></c></row>'
    return replacing(SHEET, ("<worksheet", document), ("</row>", cell))


def linked_cells(server: Server) -> Callable[[dict[str, bytes]], dict[str, bytes]]:
    """Formulas that take a cell of another workbook, a web service and a program."""
    cells = "".join(
        f'<c r="{column}1"><f>{formula}</f></c>'
        for column, formula in (
            ("D", f"'file://{server.folder}/[s.xlsx]Sheet1'!A1"),
            ("E", f'WEBSERVICE("file://{server.text}")'),
            ("F", f"cmd|'/C cat {server.text}'!A0"),
        )
    )
    return replacing(SHEET, ("</row>", f"{cells}</row>"))


def open_document(server: Server, third: str = "torque") -> bytes:
    """An OpenDocument sheet with a table that lies elsewhere, and an entity that does."""
    rows = "".join(
        "<table:table-row>"
        + "".join(
            f'<table:table-cell office:value-type="float" office:value="{v!r}"><text:p>{v}</text:p>'
            "</table:table-cell>"
            for v in (float(t), float(q), float(tau))
        )
        + "</table:table-row>"
        for t, q, tau in zip(TIME_S[:50], ANGLE[:50], TORQUE[:50], strict=True)
    )
    names = "".join(
        f'<table:table-cell office:value-type="string"><text:p>{name}</text:p></table:table-cell>'
        for name in ("t", "position", third)
    )
    space = "urn:oasis:names:tc:opendocument:xmlns"
    content = (
        f'<?xml version="1.0"?><!DOCTYPE d [<!ENTITY e SYSTEM "file://{server.text}">]>'
        f'<office:document-content xmlns:office="{space}:office:1.0" xmlns:table="{space}:table:1.0" '
        f'xmlns:text="{space}:text:1.0" xmlns:xlink="http://www.w3.org/1999/xlink"><office:body>'
        '<office:spreadsheet><table:table table:name="A">'
        f'<table:table-source xlink:href="file://{server.csv}" table:table-name="s"/>'
        f"<table:table-row>{names}</table:table-row>{rows}"
        "</table:table></office:spreadsheet></office:body></office:document-content>"
    )
    kind = b"application/vnd.oasis.opendocument.spreadsheet"
    manifest = f'<?xml version="1.0"?><m:manifest xmlns:m="{space}:manifest:1.0"></m:manifest>'
    return zipped(
        {
            "mimetype": kind,
            "content.xml": content.encode(),
            "META-INF/manifest.xml": manifest.encode(),
        }
    )


def matlab_5(kind: int, body: bytes) -> bytes:
    """A MATLAB 5 file of one variable of a class that scipy does not write, and two vectors."""
    import scipy.io

    buffer = io.BytesIO()
    scipy.io.savemat(buffer, {"t": TIME_S, "position": ANGLE, "torque": TORQUE})

    def element(number: int, data: bytes) -> bytes:
        return struct.pack("<II", number, len(data)) + data + bytes(-len(data) % 8)

    flags = element(6, struct.pack("<II", kind, 0))
    if kind == 17:  # opaque: no dimensions, but three names
        inner = flags + b"".join(element(1, text) for text in (b"f", b"MCOS", b"timeseries")) + body
    else:
        inner = flags + element(5, struct.pack("<ii", 1, 1)) + element(1, b"f") + body
    return buffer.getvalue() + element(14, inner)


def function_handle(server: Server) -> bytes:
    """A function handle that names a file of code."""
    text = f"{server.folder}/s.m".encode()
    characters = struct.pack("<II", 16, len(text)) + text + bytes(-len(text) % 8)
    flags = struct.pack("<IIII", 6, 8, 4, 0)
    size = struct.pack("<IIii", 5, 8, 1, len(text))
    name = struct.pack("<II", 1, 0)
    inner = flags + size + name + characters
    return matlab_5(16, struct.pack("<II", 14, len(inner)) + inner)


def member(name: str, target: str) -> bytes:
    """A zip archive whose one member is a symbolic link."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        info = zipfile.ZipInfo(name)
        info.create_system, info.external_attr = 3, (stat.S_IFLNK | 0o777) << 16
        archive.writestr(info, target)
    return buffer.getvalue()


def mdf_attachment(server: Server) -> bytes:
    """An MDF file whose channel keeps its values in an attachment, which is a file of the server."""
    from asammdf import MDF, Signal

    with MDF(version="4.10") as file:
        file.append([Signal(v, TIME_S, name=n) for n, v in (("position", ANGLE), ("torque", TORQUE))])
        number = file.attach(server.raw.read_bytes(), file_name=str(server.raw), embedded=False)
        file.groups[0].channels[-1].attachment = number
        return Path(file.save(server.folder / "made", overwrite=True)).read_bytes()


Build = Callable[[Server], bytes]
OTHERS: dict[str, tuple[str, Build, str]] = {
    "user-defined link": ("u.h5", user_defined_link, "link"),
    "bag, way up": ("b.zip", lambda s: bag_with(s, "sqlite3", naming(f"{s.climb()}{s.bag}")), "missing"),
    "bag, absolute": ("b.zip", lambda s: bag_with(s, "sqlite3", naming(str(s.bag))), "missing"),
    "bag, parent": ("b.zip", lambda s: bag_with(s, "sqlite3", naming("..")), "cannot be read"),
    "bag, mcap, way up": (
        "b.zip",
        lambda s: bag_with(s, "mcap", naming(f"{s.climb()}{s.bag}")),
        "missing",
    ),
    "bag, escaped": ("b.zip", lambda s: bag_with(s, "sqlite3", escaped(s)), "rename"),
    "bag, escaped, compressed": (
        "b.zip",
        lambda s: bag_with(s, "sqlite3", lambda f: compressed(escaped(s, ".zstd")(f))),
        "rename",
    ),
    "bag, query": (
        "b.zip",
        lambda s: bag_with(s, "sqlite3", naming("a.db3?x=1", there="a.db3?x=1")),
        "rename",
    ),
    "bag, YAML": (
        "b.zip",
        lambda s: bag_with(s, "sqlite3", yaml_with(f"!!python/object/apply:builtins.open ['{s.text}']")),
        "cannot be read",
    ),
    "bag, include": (
        "b.zip",
        lambda s: bag_with(s, "sqlite3", yaml_with(f"!include {s.text}")),
        "cannot be read",
    ),
    "database, readfile": (
        "b.db3",
        lambda s: database_with(s, *view(f"readfile('{s.text}')")),
        "missing tables",
    ),
    "database, extension": (
        "b.db3",
        lambda s: database_with(s, *view(f"load_extension('{s.text}')")),
        "missing tables",
    ),
    "database, module": (
        "b.db3",
        lambda s: database_with(s, *virtual_table(f'csv(filename="{s.csv}")')),
        "cannot be read",
    ),
    "parquet, elsewhere": ("p.parquet", parquet_elsewhere, ""),
    "parquet, pickled": ("p.parquet", parquet_pickled, ""),
    "workbook, links": ("w.xlsx", lambda s: workbook(s, linked_cells(s)), ""),
    "workbook, entity": (
        "w.xlsx",
        lambda s: workbook(s, entity(f"file://{s.text}")),
        "unrecognized entity",
    ),
    "workbook, laughs": ("w.xlsx", lambda s: workbook(s, many_laughs()), "unrecognized entity"),
    "workbook, sheet elsewhere": (
        "w.xlsx",
        lambda s: workbook(
            s,
            replacing(
                "xl/_rels/workbook.xml.rels",
                ("/xl/worksheets/sheet1.xml", f"file://{s.xml}"),
            ),
        ),
        "cannot be read",
    ),
    "OpenDocument": ("w.ods", open_document, ""),
    "OpenDocument, entity": ("w.ods", lambda s: open_document(s, "&e;"), "cannot be read"),
    "MATLAB 5, function": ("m.mat", function_handle, ""),
    "MATLAB 5, object": (
        "m.mat",
        lambda s: matlab_5(17, struct.pack("<II", 14, 0)),
        "",
    ),
    "zip, link": ("z.zip", lambda s: member("a.csv", str(s.csv)), "is a link"),
    "zip, link as workbook": (
        "z.xlsx",
        lambda s: member("xl/workbook.xml", str(s.xml)),
        "cannot be read",
    ),
    "zip, way up": (
        "z.zip",
        lambda s: zipped({s.climb() + str(s.csv)[1:]: b"1,2"}),
        "leaves its folder",
    ),
    "zip, absolute": ("z.zip", lambda s: zipped({str(s.csv): b"1,2"}), "absolute"),
}


# --- What comes of them

Result = tuple[Any, ...] | JointIdError
CASES = [(name, f"log.{ending}") for name in HDF5 for ending in ("h5", "mat")]
CASES += [(name, file) for name, (file, _, _) in OTHERS.items()]


def expected(name: str) -> str:
    """Part of the message, or "" for a log that is read without what it names."""
    return HDF5[name][1] if name in HDF5 else OTHERS[name][2]


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Server:
    return Server(tmp_path_factory.mktemp("server"))


@pytest.fixture(scope="module")
def attacks(server: Server) -> dict[tuple[str, str], bytes]:
    made = {}
    for name, file in CASES:
        if name in OTHERS:
            made[name, file] = OTHERS[name][1](server)
        else:
            made[name, file] = (hdf5_with if file.endswith(".h5") else matlab_with)(
                HDF5[name][0], server
            )
    return made


@pytest.fixture(scope="module")
def uploaded(attacks: dict[tuple[str, str], bytes]) -> dict[tuple[str, str], Result]:
    """As the app reads what is dropped on its page: bytes and a name."""
    results = read_logs((data, file) for (_, file), data in attacks.items())
    return dict(zip(attacks, results, strict=True))


@pytest.fixture(scope="module")
def opened(
    attacks: dict[tuple[str, str], bytes], tmp_path_factory: pytest.TempPathFactory
) -> dict[tuple[str, str], Result]:
    """As the command line reads it: by its path."""
    paths = [tmp_path_factory.mktemp("own") / file for _, file in attacks]
    for path, data in zip(paths, attacks.values(), strict=True):
        path.write_bytes(data)
    return dict(zip(attacks, read_logs((path, "") for path in paths), strict=True))


def disclosed(result: Result) -> str:
    """Everything that a result says, numbers as numbers and as letters."""
    if isinstance(result, JointIdError):
        return str(result)
    parts = []
    for table in result:
        parts += [table.name, table.source, *table.notes, *table.names, *(c.unit for c in table.columns)]
        for column in table.columns:
            values = column.values[np.isfinite(column.values)]
            letters = values[(values > 0) & (values < 128) & (values % 1 == 0)].astype(np.uint8)
            parts += [" ".join(f"{value:.10g}" for value in values), letters.tobytes().decode()]
    return "\n".join(parts)


def assert_nothing_disclosed(text: str) -> None:
    assert WORD not in text
    assert f"{NUMBER:.10g}" not in text


def test_the_secrets_would_be_recognised(server: Server) -> None:
    own = [server.hdf5, server.parquet, server.csv, server.bag]
    for result in read_logs((path, "") for path in own):
        text = disclosed(result)
        assert WORD in text or f"{NUMBER:.10g}" in text


@pytest.mark.parametrize("case", CASES, ids=" in ".join)
@pytest.mark.parametrize("way", ["uploaded", "opened"])
def test_a_log_shows_no_file_of_the_server(
    case: tuple[str, str], way: str, request: pytest.FixtureRequest
) -> None:
    result: Result = request.getfixturevalue(way)[case]
    assert_nothing_disclosed(disclosed(result))
    if part := expected(case[0]):
        assert isinstance(result, JointIdError), result
        assert part in str(result)
    else:
        assert not isinstance(result, JointIdError), result
        assert "position" in {name for table in result for name in table.names}


def test_the_message_names_dataset_and_remedy(uploaded: dict[tuple[str, str], Result]) -> None:
    for name, dataset in {
        "external, nested": "/a/b/torque",
        "virtual": "/torque",
        "link to a group": "/g",
        "scope, label": "/Scope/signals/label",
        "references": "/#refs#/l",
    }.items():
        message = str(uploaded[name, "log.h5"])
        assert f'log.h5: "{dataset}" ' in message
        assert "copy them into an ordinary dataset" in message
    assert "filter 32001" in str(uploaded["filter", "log.h5"])
    assert "Save it with gzip" in str(uploaded["filter", "log.h5"])


def test_attachments_of_mdf_are_not_opened(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    path, opened = server.folder / "log.mf4", []
    path.write_bytes(mdf_attachment(server))
    monkeypatch.setattr(Path, "read_bytes", lambda path: opened.append(path) or b"")
    (table,) = readers()["mdf"].read("log.mf4", str(path))
    assert table.names == ("time", "position", "torque")
    assert not opened


def test_soft_links_within_a_log_are_not_followed(server: Server) -> None:
    data = hdf5_with(lambda file, _: file.__setitem__("latest", h5py.SoftLink("/position")), server)
    (table,) = read_log(data, "log.h5")
    assert sorted(table.names) == ["position", "time"]


@pytest.mark.parametrize("name", ["external storage", "virtual", "link", "scope, label", "bag, escaped"])
def test_convert_shows_no_file_of_the_server(
    name: str, attacks: dict[tuple[str, str], bytes], tmp_path: Path
) -> None:
    file = OTHERS[name][0] if name in OTHERS else "log.h5"
    (tmp_path / file).write_bytes(attacks[name, file])
    guess = tmp_path / "mapping.json"
    result = CliRunner().invoke(app, ["convert", str(tmp_path / file), "--guess", str(guess)])
    assert result.exit_code == 1
    assert not guess.exists()
    assert expected(name) in " ".join(result.stderr.split())
    assert_nothing_disclosed(result.output)


def test_the_page_shows_no_file_of_the_server(
    attacks: dict[tuple[str, str], bytes],
    sample_folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(workspace, "SAMPLES", sample_folder)
    monkeypatch.setenv("JOINTID_DATA_DIR", str(tmp_path / "data"))
    page = AppTest.from_file(str(APP), default_timeout=120).run()
    page = page.switch_page("pages/9_Import_a_log.py").run()
    # One log of each format for each message: "uploaded" reads them all in the same way.
    refused = {(expected(name), file): data for (name, file), data in attacks.items() if expected(name)}
    page.file_uploader(key="log_file").set_value(
        [
            (f"{number} {file}", data, "application/octet-stream")
            for number, ((_, file), data) in enumerate(refused.items())
        ]
    )
    page = page.run()
    assert not page.exception
    assert len(page.error) == len(refused)
    assert_nothing_disclosed("\n".join(error.value for error in page.error))


# --- Bags and studies in folders


def test_links_in_a_bag_are_followed_on_the_users_computer(tmp_path: Path) -> None:
    # Who names a folder on the command line may read what its links lead to; data managers store large
    # files that way. An upload has no links: archives with links are refused.
    bag = ros_bag(tmp_path, "mcap")
    linked = tmp_path / "linked"
    linked.mkdir()
    for file in bag.iterdir():
        (linked / file.name).symlink_to(file)
    assert read_log(linked)[0].rows == ROWS


def record_named(folder: Path, file: str) -> None:
    """Have study.toml name another file as its first record."""
    toml = folder / "study.toml"
    text = toml.read_text("utf-8")
    toml.write_text(re.sub(r'file = "[^"]*"', f'file = "{file}"', text, count=1), "utf-8")


def linked_record(folder: Path, server: Server) -> None:
    """Put a link in place of a record."""
    record = next((folder / "records").iterdir())
    record.unlink()
    record.symlink_to(server.csv)


def linked_folder(folder: Path, server: Server) -> None:
    """Put a link in place of the folder of all records."""
    shutil.rmtree(folder / "records")
    (folder / "records").symlink_to(server.folder)
    record_named(folder, "records/s.csv")


def linked_study(folder: Path, server: Server) -> None:
    """Put a link in place of study.toml."""
    (folder / "study.toml").unlink()
    (folder / "study.toml").symlink_to(server.text)


STUDIES: dict[str, tuple[Callable[[Path, Server], None], str]] = {
    "absolute": (lambda f, s: record_named(f, str(s.csv)), "absolute"),
    "way up": (lambda f, s: record_named(f, s.climb() + str(s.csv)[1:]), "leaves its folder"),
    "address": (lambda f, s: record_named(f, f"file://{s.csv}"), "missing"),
    "link": (linked_record, "link that leaves"),
    "linked folder": (linked_folder, "link that leaves"),
    "linked study.toml": (linked_study, "link that leaves"),
}


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_shows_no_file_of_the_server(
    name: str, server: Server, sample_folder: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "cell"
    shutil.copytree(sample_folder / "one_joint", folder)
    change, part = STUDIES[name]
    change(folder, server)
    with pytest.raises(JointIdError, match=part) as caught:
        load_study(folder)
    assert_nothing_disclosed(str(caught.value) + lines_around(folder, caught.value))
    result = CliRunner().invoke(app, ["identify", str(folder)])
    assert result.exit_code == 1
    assert_nothing_disclosed(result.output)


@pytest.mark.parametrize("build", [parquet_elsewhere, parquet_pickled])
def test_a_parquet_record_shows_no_file_of_the_server(
    build: Build, server: Server, sample_folder: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "cell"
    shutil.copytree(sample_folder / "one_joint", folder)
    record_named(folder, "records/made.parquet")
    (folder / "records/made.parquet").write_bytes(build(server))
    with pytest.raises(JointIdError, match="time_s") as caught:
        load_study(folder)
    assert_nothing_disclosed(str(caught.value) + lines_around(folder, caught.value))


@pytest.mark.parametrize("name", ["absolute", "way up", "address", "link"])
def test_a_zipped_study_shows_no_file_of_the_server(
    name: str, server: Server, sample_folder: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "cell"
    shutil.copytree(sample_folder / "one_joint", folder)
    change, _ = STUDIES[name]
    change(folder, server)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for path in sorted(folder.rglob("*")):
            info = zipfile.ZipInfo(path.relative_to(folder).as_posix())
            if path.is_symlink():
                info.create_system, info.external_attr = 3, (stat.S_IFLNK | 0o777) << 16
                archive.writestr(info, str(path.readlink()))
            elif path.is_file():
                archive.writestr(info, path.read_bytes())
    with pytest.raises(JointIdError) as caught:
        load_study(buffer.getvalue())
    assert_nothing_disclosed(str(caught.value))
