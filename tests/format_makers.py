"""Logs in the formats of controllers, measurement systems and tools; all of our own making."""

from __future__ import annotations

import io
import json
import re
import struct
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from log_makers import ANGLE, ROWS, TIME_S, TORQUE

from jointid.arrays import Floats

FILETIME = 133_000_000_000_000_000
STEP_S = 2e-3


def twincat(
    *,
    separator: str = "\t",
    decimal: str = ",",
    full_stamps: bool = False,
    shared: bool = False,
    eof: bool = True,
) -> bytes:
    """A TwinCAT Scope export: an angle at 500 Hz, a torque of thousandths at 250 Hz with scale 0.001."""
    channels = [
        ("Axis1.ActPos", "REAL64", "2", "1", "° (Angle)"),
        ("Axis1.ActTorque", "INT16", "4", "0.001", "Nm (Torque)"),
    ]
    if shared:
        channels[1] = ("Axis1.ActTorque", "REAL64", "2", "1", "Nm (Torque)")
    rows = [
        ["Name", "scope"],
        ["File", r"C:\scope.csv"],
        ["Starttime of export", str(FILETIME), "Montag, 2. Mai 2022"],
    ]
    rows += [["Endtime of export", str(FILETIME + 10_000_000)], [], []]
    keys = ("Name", "Data-Type", "SampleTime[ms]", "ScaleFactor", "Unit")
    about: list[list[str]] = []
    for k, key in enumerate(keys):
        one, two = (channel[k] for channel in channels)
        about.append([key, one, two] if shared else [key, one, key, two])
        if key == "Name":
            about.append(
                ["VariableSize", "8", "8"] if shared else ["VariableSize", "8", "VariableSize", "2"]
            )
    about.append(["NetID", "1.2.3.4.1.1", *([] if shared else ["NetID"]), "1.2.3.4.1.1"])
    cells = []
    for k in range(ROWS):
        row = [_stamp(2 * k, full_stamps), f"{np.degrees(ANGLE[k]):.9g}"]
        if shared:
            row.append(f"{TORQUE[k]:.9g}")
        elif k < ROWS // 2:
            row += [_stamp(4 * k, full_stamps), str(round(1e3 * TORQUE[2 * k]))]
        cells.append([cell.replace(".", decimal) for cell in row])
    lines = [separator.join(row) for row in (*rows, *about, [], *cells, ["EOF"] if eof else [])]
    return "\r\n".join(lines).encode()


def _stamp(milliseconds: int, full: bool) -> str:
    return str(FILETIME + milliseconds * 10_000) if full else str(milliseconds)


def _codesys_variables(step: float) -> list[tuple[str, list[str], list[str]]]:
    stamps = [str(round(t / step)) for t in TIME_S]
    return [
        ("Application.PLC_PRG.lrActPosition", stamps, [f"{v:.9g}" for v in ANGLE]),
        ("Application.PLC_PRG.lrActTorque", stamps, [f"{v:.9g}" for v in TORQUE]),
    ]


def codesys_trace(*, microseconds: bool = False) -> bytes:
    """A .trace of CODESYS: UTF-16 with a mark."""
    blocks = "".join(
        f'<TraceVariable VarName="{name}" VariableIndex="{k}" Type="System.Double">'
        f"<Values>{','.join(values)}</Values><Timestamps>{','.join(stamps)}</Timestamps></TraceVariable>"
        for k, (name, stamps, values) in enumerate(_codesys_variables(1e-6 if microseconds else 1e-3))
    )
    text = (
        '<Trace><TraceConfiguration><Single Name="Record"><Single Name="MicroSeconds" Type="bool">'
        f"{microseconds}</Single></Single></TraceConfiguration>"
        f'<TraceData Version="1.0.0.0"><TraceRecord>{blocks}</TraceRecord></TraceData></Trace>'
    )
    return text.encode("utf-16")


def codesys_csv(*, microseconds: bool = False) -> bytes:
    """A trace of CODESYS saved as .csv."""
    lines = ["[key]; [value]", "Version; 0x03050000", f"Flags; {32 if microseconds else 16}"]
    for k, (name, stamps, values) in enumerate(_codesys_variables(1e-6 if microseconds else 1e-3)):
        lines += [f"{k}.Variable; {name}", f"{k}.Color; 255", f"{k}.Data; "]
        lines += [f"; {stamp}; {value}" for stamp, value in zip(stamps, values, strict=True)]
    return "\r\n".join([*lines, ""]).encode()


def codesys_text() -> bytes:
    """A trace of CODESYS saved as .txt."""
    (one, stamps, q), (two, _, tau) = _codesys_variables(1e-3)
    lines = ["CODESYS V3.5 Trace: Trace", r"C:\Cell.project", f"Timestamp(ms) {one} {two}"]
    return "\r\n".join(
        [*lines, *(" ".join(row) for row in zip(stamps, q, tau, strict=True)), ""]
    ).encode()


def lvm(*, decimal: str = ",", x_columns: str = "One", segments: int = 1) -> bytes:
    """A LabVIEW measurement with units; without X columns the times follow from X0 and Delta_X."""
    head = ["LabVIEW Measurement\t", "Writer_Version\t2", "Reader_Version\t2", "Separator\tTab"]
    head += [
        f"Decimal_Separator\t{decimal}",
        "Multi_Headings\tYes",
        f"X_Columns\t{x_columns}",
        "***End_of_Header***\t\t",
    ]
    lines = head
    gap = "\t\t" if x_columns == "Multi" else "\t"  # entries stand above the values
    for rows in np.array_split(np.arange(ROWS), segments):
        lines += [
            "",
            "Channels\t2\t\t",
            f"Samples\t{rows.size}{gap}{rows.size}",
            f"Y_Unit_Label\tDegrees{gap}Nm",
        ]
        start = TIME_S[rows[0]] if x_columns == "No" else 0.0
        lines += [
            f"X_Dimension\tTime{gap}Time",
            f"X0\t{start:.7E}{gap}{start:.7E}",
            f"Delta_X\t{STEP_S}{gap}{STEP_S}",
        ]
        lines += ["***End_of_Header***\t\t\t"]
        names = {"One": ["X_Value", "Position", "Torque"], "No": ["X_Value", "Position", "Torque"]}
        lines.append(
            "\t".join([*names.get(x_columns, ["X_Value", "Position", "X_Value", "Torque"]), "Comment"])
        )
        for k in rows:
            time, q, tau = (f"{v:.9g}" for v in (TIME_S[k], np.degrees(ANGLE[k]), TORQUE[k]))
            lines.append(
                "\t".join(
                    {"One": [time, q, tau], "No": ["", q, tau]}.get(x_columns, [time, q, time, tau])
                )
            )
    return "\r\n".join(line.replace(".", decimal) for line in [*lines, ""]).encode()


def tdms(*, waveform: bool = True) -> bytes:
    """A TDMS file: two waveforms, or two channels beside one of times."""
    from nptdms import ChannelObject, TdmsWriter

    properties = {"wf_increment": STEP_S, "wf_start_offset": 0.0} if waveform else {}
    parts = [
        ChannelObject("run", "position", np.degrees(ANGLE), properties | {"unit_string": "deg"}),
        ChannelObject("run", "torque", TORQUE, properties | {"unit_string": "Nm"}),
    ]
    if not waveform:
        parts.insert(0, ChannelObject("run", "Time", 1e3 * TIME_S, {"unit_string": "ms"}))
    buffer = io.BytesIO()
    with TdmsWriter(buffer) as writer:
        writer.write_segment(parts)
    return buffer.getvalue()


def mdf(*, version: str = "4.10") -> bytes:
    """An MDF file whose angle and torque have rasters of their own."""
    from asammdf import MDF, Signal

    slow = slice(0, ROWS, 2)
    with tempfile.TemporaryDirectory() as folder, MDF(version=version) as file:
        file.append([Signal(np.degrees(ANGLE), TIME_S, unit="deg", name="motor_position")])
        file.append([Signal(TORQUE[slow], TIME_S[slow], unit="Nm", name="motor_torque")])
        path = file.save(Path(folder, "log"), overwrite=True)
        return Path(path).read_bytes()


def dspace() -> bytes:
    """A recording of dSPACE ControlDesk: X and Y structs, two rasters."""
    import scipy.io

    slow = slice(0, ROWS, 2)
    kind = [("Name", object), ("Type", object), ("Data", object), ("Unit", object)]
    clocks = np.array(
        [("Time", "double", TIME_S, "s"), ("Time", "double", TIME_S[slow], "s")], dtype=kind
    )
    channels = np.array(
        [
            ('"Model Root"/"Drive"/"q_motor[rad]"/"Out1"', "double", ANGLE, "rad", 1),
            ('"Model Root"/"Drive"/"tau_motor"/"Out1"', "double", TORQUE[slow], "Nm", 2),
        ],
        dtype=[*kind, ("XIndex", object)],
    )
    recording = {"X": clocks, "Y": channels, "Description": "run", "Capture": {"Length": 0.8}}
    buffer = io.BytesIO()
    scipy.io.savemat(buffer, {"exp_001": recording})
    return buffer.getvalue()


def halscope(*, old: bool = False, decimal: str = ".") -> bytes:
    """A capture of halscope, of the old or the new kind."""
    names = ("axis.0.joint-pos-fb", "axis.0.torque")
    pairs = zip(ANGLE, TORQUE, strict=True)
    if old:
        lines = [f"Sampling period is {round(STEP_S * 1e9)} nSec ", ""]
        lines += [f"{names[0]} {q:+.14f} {names[1]} {tau:+.14f} " for q, tau in pairs]
    else:
        lines = [f"# Sampling period is {round(STEP_S * 1e9)} ns", ";".join(names)]
        lines += ["# Position: 0.500000;0.500000", "# Scale: 0;0"]
        lines += [f"{q:.14f};{tau:.14f}" for q, tau in pairs]
    head, *rest = lines
    rest = [
        line if line == ";".join(names) else re.sub(r"(?<=\d)\.(?=\d)", decimal, line) for line in rest
    ]
    return "\n".join([head, *rest, ""]).encode()


def wpilog() -> bytes:
    """A WPILib data log: an angle as double, torques as an array of float, and a text."""
    out = bytearray(b"WPILOG\x00\x01" + struct.pack("<I", 5) + b"extra")

    def record(number: int, stamp: int, payload: bytes) -> None:
        size = max(1, (len(payload).bit_length() + 7) // 8)
        out.extend([(size - 1) << 2 | 3 << 4, number])
        out.extend(len(payload).to_bytes(size, "little") + stamp.to_bytes(4, "little") + payload)

    def begin(number: int, name: bytes, kind: bytes) -> None:
        parts = b"".join(struct.pack("<I", len(text)) + text for text in (name, kind, b"{}"))
        record(0, 0, b"\0" + struct.pack("<I", number) + parts)

    begin(1, b"/arm/joint1/position", b"double")
    begin(2, b"/arm/joint1/torque", b"float[]")
    begin(3, b"/messages", b"string")
    record(3, 7, b"enabled")
    for k in range(ROWS):
        stamp = 1_000_000 + 2000 * k
        record(1, stamp, struct.pack("<d", ANGLE[k]))
        record(2, stamp, struct.pack("<f", TORQUE[k]))
    return bytes(out)


def npz(*, compressed: bool = True) -> bytes:
    """Arrays of NumPy, with an array of objects that is left out."""
    buffer = io.BytesIO()
    save: Callable[..., None] = np.savez_compressed if compressed else np.savez
    save(buffer, time_s=TIME_S, q_rad=ANGLE, tau_Nm=TORQUE, note=np.array([{"run": 3}], dtype=object))
    return buffer.getvalue()


def npy() -> bytes:
    """One structured array of NumPy."""
    kind = [("time", "f8"), ("position", "f4"), ("torque", "f8")]
    table = np.zeros(ROWS, kind)
    table["time"], table["position"], table["torque"] = TIME_S, ANGLE, TORQUE
    buffer = io.BytesIO()
    np.save(buffer, table)
    return buffer.getvalue()


def json_lines() -> bytes:
    """Rows as JSON objects with nested names and lists."""
    rows = [
        {"time": t, "joint1": {"position": q, "torque": tau}, "state": "run", "pair": [1, 2]}
        for t, q, tau in zip(TIME_S.tolist(), ANGLE.tolist(), TORQUE.tolist(), strict=True)
    ]
    return "\n".join([*(json.dumps(row) for row in rows), ""]).encode()


def json_columns() -> bytes:
    """Columns as JSON arrays."""
    return json.dumps(
        {"t": TIME_S.tolist(), "q": ANGLE.tolist(), "tau": TORQUE.tolist(), "rate": 500}
    ).encode()


def _table() -> Any:
    import pyarrow as pa

    q, tau = np.column_stack([ANGLE, -ANGLE]), np.column_stack([TORQUE, 2 * TORQUE])
    return pa.table(
        {"t_s": TIME_S, "q_rad": q.tolist(), "tau_Nm": pa.array(tau.tolist(), pa.list_(pa.float64(), 2))}
    )


def arrow(*, stream: bool = False) -> bytes:
    """Feather, or a stream of Arrow, with lists of two joints."""
    import pyarrow as pa

    buffer, table = io.BytesIO(), _table()
    with (pa.ipc.new_stream if stream else pa.ipc.new_file)(buffer, table.schema) as writer:
        writer.write_table(table, max_chunksize=150)
    return buffer.getvalue()


def parquet_lists() -> bytes:
    """Parquet with lists of two joints."""
    import pyarrow.parquet as pq

    buffer = io.BytesIO()
    pq.write_table(_table(), buffer)
    return buffer.getvalue()


def parquet_runs() -> bytes:
    """Parquet with one row per run and a list per signal."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    buffer = io.BytesIO()
    runs = {
        "t_s": [TIME_S, TIME_S],
        "q_rad": [ANGLE, 2 * ANGLE],
        "tau_Nm": [TORQUE, 2 * TORQUE],
        "run": [1, 2],
    }
    pq.write_table(pa.table(runs), buffer)
    return buffer.getvalue()


def tidy(*, separator: str = ";", decimal: str = ",", stamps: bool = False) -> bytes:
    """A long table: one value per row; the torque has half the rate."""
    lines = [separator.join(["time" if stamps else "Zeit [ms]", "signal", "value", "unit"])]
    for k in range(ROWS):
        time = f"2026-11-22 09:00:{TIME_S[k]:06.3f}" if stamps else f"{2 * k}"
        for name, value, unit in (("Position 1", ANGLE[k], "rad"), ("Moment 1", TORQUE[k], "Nm"))[
            : 2 - k % 2
        ]:
            lines.append(separator.join([time, name, f"{value:.9g}".replace(".", decimal), unit]))
    return "\n".join([*lines, ""]).encode()


def per_joint(*, named: bool = False) -> bytes:
    """A row per joint and time; the second joint moves the other way."""
    rows = ["time_s,joint,position_rad,velocity,torque_Nm"]
    for t, q, tau in zip(TIME_S, ANGLE, TORQUE, strict=True):
        for joint, sign in (("J1" if named else "1", 1), ("J2" if named else "2", -1)):
            rows.append(f"{t:.6f},{joint},{sign * q:.9g},,{sign * tau:.9g}")
    return "\n".join(rows).encode()


def per_joint_rows() -> list[dict[str, float]]:
    """The same with a number of the axis, as JSON and workbooks hold it."""
    return [
        {"ts": t, "axis": axis, "pos": sign * q, "trq": sign * tau}
        for t, q, tau in zip(TIME_S.tolist(), ANGLE.tolist(), TORQUE.tolist(), strict=True)
        for axis, sign in ((1, 1), (2, -1))
    ]


def json_per_joint() -> bytes:
    """A JSON object per joint and time."""
    return "\n".join(map(json.dumps, per_joint_rows())).encode()


def ros_arrays(folder: Path) -> bytes:
    """A ROS 2 bag whose joint states lack efforts; the torques are in a Float64MultiArray."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    names = ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    state, header, stamp = (store.types[name] for name in names)
    many, layout = (store.types[f"std_msgs/msg/{n}"] for n in ("Float64MultiArray", "MultiArrayLayout"))
    path = folder / "arrays"
    with Writer(path, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        states = writer.add_connection("/joint_states", state.__msgtype__, typestore=store)
        torques = writer.add_connection("/measured_torques", many.__msgtype__, typestore=store)
        writer.add_connection("/status", "std_msgs/msg/String", typestore=store)
        for k in range(ROWS):
            ns = 1_700_000_000_000_000_000 + k * 2_000_000
            message = state(
                header=header(stamp=stamp(*divmod(ns, 1_000_000_000)), frame_id=""),
                name=["joint1"], position=ANGLE[[k]], velocity=np.array([]), effort=np.array([]),
            )  # fmt: skip
            writer.write(states, ns, store.serialize_cdr(message, state.__msgtype__))
            if k % 2 == 0:
                numbers = many(layout=layout(dim=[], data_offset=0), data=np.array([TORQUE[k], 7.0]))
                writer.write(torques, ns, store.serialize_cdr(numbers, many.__msgtype__))
    (file,) = path.glob("*.mcap")
    return file.read_bytes()


def matrix(columns: Sequence[Floats]) -> bytes:
    """Numbers without names."""
    rows = zip(*columns, strict=True)
    return "\n".join([*(",".join(f"{v:.9g}" for v in row) for row in rows), ""]).encode()


FORMATS: dict[str, Callable[[Path], bytes]] = {
    "twincat.csv": lambda _: twincat(),
    "codesys.trace": lambda _: codesys_trace(),
    "codesys.csv": lambda _: codesys_csv(),
    "codesys.txt": lambda _: codesys_text(),
    "labview.lvm": lambda _: lvm(),
    "labview.tdms": lambda _: tdms(),
    "measured.mf4": lambda _: mdf(),
    "measured.mdf": lambda _: mdf(version="3.30"),
    "dspace.mat": lambda _: dspace(),
    "halscope.log": lambda _: halscope(),
    "halscope.csv": lambda _: halscope(old=True),
    "frc.wpilog": lambda _: wpilog(),
    "log.npz": lambda _: npz(),
    "log.npy": lambda _: npy(),
    "log.jsonl": lambda _: json_lines(),
    "long.jsonl": lambda _: json_per_joint(),
    "log.json": lambda _: json_columns(),
    "log.feather": lambda _: arrow(),
    "log.arrow": lambda _: arrow(stream=True),
    "lists.parquet": lambda _: parquet_lists(),
    "tidy.csv": lambda _: tidy(),
    "arrays.mcap": ros_arrays,
}
"""A log of every format by file name, given a folder to make it in; all hold ANGLE and TORQUE."""
