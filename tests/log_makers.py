"""Logs of every kind, made for the tests."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from pathlib import Path

import numpy as np
from plants import PAPER, PARALLELOGRAM

from jointid import Controller, Excitation, Measurement, simulate_records
from jointid.arrays import Floats
from jointid.importing import Guess, Reason

ROWS = 400
TIME_S = np.arange(ROWS) * 2e-3
ANGLE = 0.3 * np.sin(2 * np.pi * 10 * TIME_S) + 0.1
TORQUE = 0.7 * np.cos(2 * np.pi * 10 * TIME_S) - 0.01


def unsure(guess: Guess) -> list[Reason]:
    """Entries of a guess that the user should check before the mapping is used."""
    return [reason for reason in guess.reasons if not reason.sure]


@cache
def cell_log(encoding: str = "latin-1", rows: int = ROWS) -> bytes:
    """A German controller's log: two remarks, semicolons, decimal commas, no UTF-8."""
    lines = ["Rob 7 / Prüfung", "Abtastzeit;2,0;ms", ""]
    lines.append("Zeit [ms];Achse 1 Ist [°];Achse 2 Ist [°];Moment 1 [%];Moment 2 [%]")
    for k in range(rows):
        row = (2 * k, np.degrees(ANGLE[k]), -np.degrees(ANGLE[k]), 10 * TORQUE[k], 20 * TORQUE[k])
        lines.append(";".join(f"{value:.7g}".replace(".", ",") for value in row))
    return ("\r\n".join(lines) + "\r\n").encode(encoding)


def comma_log(rows: int = ROWS) -> bytes:
    """Plain CSV with a header."""
    table = np.column_stack([TIME_S, ANGLE, TORQUE])[:rows]
    lines = [",".join(repr(float(value)) for value in row) for row in table]
    return "\n".join(["t,position,effort", *lines, ""]).encode()


def mat_scope(signals: Floats | None = None) -> bytes:
    """What a Simulink scope logs, version 5."""
    import scipy.io

    values = np.column_stack([TORQUE, ANGLE, 0.1 * ANGLE]) if signals is None else signals
    scope = {
        "time": TIME_S[:, None],
        "signals": {"values": values, "dimensions": values.shape[-1], "label": ""},
        "blockName": "model/Scope",
    }
    buffer = io.BytesIO()
    scipy.io.savemat(buffer, {"ScopeData": scope, "gain": 3.0}, do_compression=True)
    return buffer.getvalue()


def mat_arrays() -> bytes:
    """Vectors, a matrix and settings, version 5."""
    import scipy.io

    log = {"q_rad": np.column_stack([ANGLE, -ANGLE]), "tau_Nm": np.column_stack([TORQUE, 2 * TORQUE])}
    buffer = io.BytesIO()
    scipy.io.savemat(buffer, {"t_s": TIME_S, **log, "Ts": 2e-3, "name": "run 1"})
    return buffer.getvalue()


def mat_v73() -> bytes:
    """What MATLAB's version 7.3 looks like: HDF5 behind a text, columns first, structs as groups."""
    import h5py

    buffer = io.BytesIO()
    with h5py.File(buffer, "w", userblock_size=512) as file:
        group = file.create_group("ScopeData")
        group.attrs["MATLAB_class"] = np.bytes_("struct")
        group["time"] = TIME_S[None, :]
        group.create_group("signals")["values"] = np.vstack([TORQUE, ANGLE])
        for name in ("time", "signals/values"):
            group[name].attrs["MATLAB_class"] = np.bytes_("double")
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    return head + buffer.getvalue()[len(head) :]


def hdf5(compound: bool = False) -> bytes:
    """A group of arrays with units as attributes, or one compound table."""
    import h5py

    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        if compound:
            kind = [("time", "f8"), ("pos", "f4"), ("torque", "f8"), ("label", "S4")]
            table = np.zeros(ROWS, kind)
            table["time"], table["pos"], table["torque"] = TIME_S, ANGLE, TORQUE
            file["log/run"] = table
        else:
            group = file.create_group("run1")
            for name, values, unit in (
                ("time", 1e3 * TIME_S, "ms"),
                ("joint1_pos", np.degrees(ANGLE), "deg"),
                ("joint1_torque", TORQUE, "Nm"),
            ):
                data = group.create_dataset(name, data=values, compression="gzip")
                data.attrs["units"] = unit
            file["settings"] = np.arange(3.0)
    return buffer.getvalue()


def parquet() -> bytes:
    """Columns of several types; time in a type of its own."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table(
        {
            "stamp": pa.array((TIME_S * 1e6).round().astype("int64")).cast(pa.timestamp("us")),
            "pos_rad": ANGLE,
            "torque_Nm": TORQUE.astype("float32"),
            "state": ["ok"] * ROWS,
        }
    )
    buffer = io.BytesIO()
    pq.write_table(table, buffer)
    return buffer.getvalue()


def excel() -> bytes:
    """Two sheets, the second with remarks above the header and a row of units."""
    import openpyxl

    book = openpyxl.Workbook()
    book.active.title = "Info"
    book.active.append(["Robot", "R7"])
    sheet = book.create_sheet("Messung")
    sheet.append(["Prüfung am Montag"])
    sheet.append([])
    sheet.append(["Zeit", "Position", "Drehmoment"])
    sheet.append(["ms", "°", "Nm"])
    for time, angle, torque in zip(TIME_S, ANGLE, TORQUE, strict=True):
        sheet.append([float(1e3 * time), float(np.degrees(angle)), float(torque)])
    buffer = io.BytesIO()
    book.save(buffer)
    return buffer.getvalue()


def ros_bag(folder: Path, kind: str, *, topic: str = "/joint_states", stamped: bool = True) -> Path:
    """A bag's folder with joint states of two joints, whose order changes; kind is sqlite3 or mcap."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    state, header, stamp = (
        store.types[name]
        for name in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    plugin = StoragePlugin.SQLITE3 if kind == "sqlite3" else StoragePlugin.MCAP
    path = folder / f"bag_{kind}_{stamped}"
    with Writer(path, version=8, storage_plugin=plugin) as writer:
        connection = writer.add_connection(topic, state.__msgtype__, typestore=store)
        for k in range(ROWS):
            order = [0, 1] if k % 3 else [1, 0]
            ns = 1_700_000_000_000_000_000 + k * 2_000_000
            clock = stamp(*divmod(ns, 1_000_000_000)) if stamped else stamp(0, 0)
            message = state(
                header=header(stamp=clock, frame_id=""),
                name=[("shoulder", "elbow")[i] for i in order],
                position=np.array([ANGLE[k], -ANGLE[k]])[order],
                velocity=np.array([]),
                effort=np.array([TORQUE[k], 2 * TORQUE[k]])[order],
            )
            writer.write(connection, ns + 500, store.serialize_cdr(message, state.__msgtype__))
    return path


def ros1_bag(folder: Path) -> Path:
    """A bag of ROS 1 with joint states of two joints."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    state, header, stamp = (
        store.types[name]
        for name in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    path = folder / "cell.bag"
    with Writer(path) as writer:
        connection = writer.add_connection("/joint_states", state.__msgtype__, typestore=store)
        for k in range(ROWS):
            ns = 1_700_000_000_000_000_000 + k * 2_000_000
            message = state(
                header=header(seq=k, stamp=stamp(*divmod(ns, 1_000_000_000)), frame_id=""),
                name=["shoulder", "elbow"],
                position=np.array([ANGLE[k], -ANGLE[k]]),
                velocity=np.array([]),
                effort=np.array([TORQUE[k], 2 * TORQUE[k]]),
            )
            writer.write(connection, ns, store.serialize_ros1(message, state.__msgtype__))
    return path


def mat_timeseries() -> bytes:
    """What ``log.q = struct(timeseries)`` saves: Time and Data of each signal."""
    import scipy.io

    def series(name: str, values: Floats, unit: str) -> dict[str, object]:
        info = {"Units": unit, "Interpolation": "linear"}
        return {"Name": name, "Time": TIME_S[:, None], "Data": values[:, None], "DataInfo": info}

    log = {"q": series("q", ANGLE, "rad"), "tau": series("tau", TORQUE, "N*m")}
    buffer = io.BytesIO()
    scipy.io.savemat(buffer, {"log": log, "note": "run 3"})
    return buffer.getvalue()


def zipped(files: dict[str, bytes]) -> bytes:
    """A zip archive."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return buffer.getvalue()


Log = tuple[Floats, Floats, Floats]
"""Time (s), shape (N,); motor angles (rad) and motor torques (N·m), each of shape (N, 2)."""


def as_csv(log: Log, ratios: tuple[float, float], rated_Nm: tuple[float, float]) -> bytes:
    """What a German cell writes: joint-side degrees, shares of the rated torque, decimal commas."""
    time, theta, tau = log
    rows = np.column_stack([1e3 * time, np.degrees(theta / ratios), 100 * tau / rated_Nm])
    lines = ["Zelle 7", "Zeit [ms];Achse 1 Ist [°];Achse 2 Ist [°];Moment 1 [%];Moment 2 [%]"]
    lines += [";".join(f"{value:.10g}".replace(".", ",") for value in row) for row in rows]
    return "\r\n".join([*lines, ""]).encode("latin-1")


def as_parquet(log: Log) -> bytes:
    """Columns by their names."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    time, theta, tau = log
    names = ["time_s", "theta_m1_rad", "theta_m2_rad", "tau_m1_Nm", "tau_m2_Nm"]
    buffer = io.BytesIO()
    pq.write_table(pa.table(dict(zip(names, [time, *theta.T, *tau.T], strict=True))), buffer)
    return buffer.getvalue()


def as_mat(log: Log) -> bytes:
    """Arrays in a file of version 5."""
    import scipy.io

    time, theta, tau = log
    buffer = io.BytesIO()
    scipy.io.savemat(buffer, {"t_s": time, "q_rad": theta, "tau_Nm": tau})
    return buffer.getvalue()


def as_mat_v73(log: Log) -> bytes:
    """The same in a file of version 7.3, columns first."""
    import h5py

    time, theta, tau = log
    buffer = io.BytesIO()
    with h5py.File(buffer, "w", userblock_size=512) as file:
        for name, values in (("t_s", time[None, :]), ("q_rad", theta.T), ("tau_Nm", tau.T)):
            file[name] = values
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    return head + buffer.getvalue()[len(head) :]


def as_hdf5(log: Log) -> bytes:
    """Arrays with their units as attributes."""
    import h5py

    time, theta, tau = log
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        parts = [("time", 1e3 * time, "ms")]
        parts += [(f"motor{j + 1}_pos", np.degrees(theta[:, j]), "deg") for j in (0, 1)]
        parts += [(f"motor{j + 1}_torque", tau[:, j], "Nm") for j in (0, 1)]
        for name, values, unit in parts:
            file.create_dataset(f"run/{name}", data=values).attrs["units"] = unit
    return buffer.getvalue()


def as_excel(log: Log) -> bytes:
    """A sheet with a row of units."""
    time, theta, tau = log
    names = ["Zeit", "Motor 1 Position", "Motor 2 Position", "Motor 1 Moment", "Motor 2 Moment"]
    rows = np.column_stack([1e3 * time, np.degrees(theta), tau]).tolist()
    return sheet_of([names, ["ms", "°", "°", "Nm", "Nm"], *rows])


def sheet_of(rows: Iterable[Sequence[object]]) -> bytes:
    """A workbook of one sheet."""
    import openpyxl

    book = openpyxl.Workbook(write_only=True)
    sheet = book.create_sheet("Messung")
    for row in rows:
        sheet.append(row)
    buffer = io.BytesIO()
    book.save(buffer)
    return buffer.getvalue()


def as_ros_bag(log: Log, folder: Path, kind: str) -> bytes:
    """The file of a bag with joint states; kind is sqlite3 or mcap."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    state, header, stamp = (
        store.types[name]
        for name in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    plugin = StoragePlugin.SQLITE3 if kind == "sqlite3" else StoragePlugin.MCAP
    path = folder / kind
    with Writer(path, version=8, storage_plugin=plugin) as writer:
        connection = writer.add_connection("/joint_states", state.__msgtype__, typestore=store)
        for time, theta, tau in zip(*log, strict=True):
            ns = 1_700_000_000_000_000_000 + round(1e9 * time)
            message = state(
                header=header(stamp=stamp(*divmod(ns, 1_000_000_000)), frame_id=""),
                name=["motor_1", "motor_2"],
                position=np.array(theta),
                velocity=np.array([]),
                effort=np.array(tau),
            )
            writer.write(connection, ns, store.serialize_cdr(message, state.__msgtype__))
    (file,) = [part for part in path.iterdir() if part.suffix in (".db3", ".mcap")]
    return file.read_bytes()


SINES_HZ = [6.0, 12.0, 26.0]


@cache
def two_joint_log() -> Log:
    """Six sine runs of one robot of two joints with a pause after each, its torque held."""
    records = simulate_records(
        PARALLELOGRAM,
        PAPER,
        SINES_HZ,
        excitation=Excitation(duration_s=1.4),
        controller=Controller(sample_rate_hz=500.0),
        measurement=Measurement(encoder_counts=1 << 20, torque_noise_Nm=0.002),
        seed=2,
    )
    times = [2.0 * k + record.time_s - record.time_s[0] for k, record in enumerate(records)]
    theta = np.concatenate([record.theta_rad for record in records])
    return np.concatenate(times), theta, np.concatenate([record.tau_Nm for record in records])


KINDS: dict[str, Callable[[Log, Path], bytes]] = {
    "log.parquet": lambda log, _: as_parquet(log),
    "log5.mat": lambda log, _: as_mat(log),
    "log73.mat": lambda log, _: as_mat_v73(log),
    "log.h5": lambda log, _: as_hdf5(log),
    "week.zip": lambda log, _: zipped({"log.parquet": as_parquet(log)}),
    "log.xlsx": lambda log, _: as_excel(log),
    "bag.db3": lambda log, folder: as_ros_bag(log, folder, "sqlite3"),
    "bag.mcap": lambda log, folder: as_ros_bag(log, folder, "mcap"),
}
"""Files that hold a log, by their names."""
