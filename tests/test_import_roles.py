"""Guessed roles: a column is proposed only for a quantity that its name, unit or shape supports."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path

import format_makers as make
import numpy as np
import pytest
from log_makers import ANGLE, TIME_S, TORQUE, unsure
from typer.testing import CliRunner

from jointid import SineRecord, extract_phasors
from jointid.cli import app
from jointid.importing import (
    Channel,
    JointMapping,
    LogColumn,
    LogTable,
    Mapping,
    TimeColumn,
    apply_mapping,
    guess_mapping,
    mapping_from_json,
    mapping_to_json,
    read_log,
)
from jointid.importing.columns.column_words import described
from jointid.importing.columns.log_table import numbers
from jointid.importing.columns.units import split_unit
from jointid.importing.map.guess import guess_unit

T = np.arange(2000) * 1e-3


def table_named(*names: str) -> LogTable:
    """Noisy sines under the names; the first column is the time."""
    rng = np.random.default_rng(1)
    columns = []
    for k, name in enumerate(names):
        bare, unit = split_unit(name)
        values = T if k == 0 else np.sin(20 * T + k) + 1e-3 * rng.standard_normal(T.size)
        columns.append(LogColumn(bare, numbers(values), unit))
    return LogTable("log", tuple(columns))


def pairs(*names: str) -> list[tuple[str, str]]:
    """Position and torque of each joint; the mapping must be one that can be written and read."""
    guess = guess_mapping(table_named(*names))
    assert mapping_from_json(mapping_to_json(guess.mapping)) == guess.mapping
    told = {reason.what for reason in unsure(guess)}
    assert set(guess.mapping.open_roles) <= told
    return [(j.position.column, j.torque.column) for j in guess.mapping.joints]


def many(form: str, count: int = 7, first: int = 0) -> list[str]:
    return [form.format(k) for k in range(first, first + count)]


FRANKA_STATE = ("q", "q_d", "dq", "dq_d", "tau_J", "tau_ext_hat_filtered")


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (
            ["time", *(n for k in range(1, 8) for n in (f"q{k}", f"dq{k}")), *many("q{}_tau", first=1)],
            [(f"q{k}", f"q{k}_tau") for k in range(1, 8)],
        ),
        (
            ["time", "success_rate", *(n for s in FRANKA_STATE for n in many(f"state.{s}[{{}}]")),
             *many("cmd.q_d[{}]"), *many("cmd.O_T_EE_d[{}]", 16), *many("cmd.tau_J_d[{}]")],
            [(f"state.q[{k}]", f"state.tau_J[{k}]") for k in range(7)],
        ),
        (
            ["duration", "success rate", *(n for s in FRANKA_STATE for n in many(f"{s}[{{}}]"))],
            [(f"q[{k}]", f"tau_J[{k}]") for k in range(7)],
        ),
        (
            ["t", "pos_vel_mapper.pos_rel", "pos_vel_mapper.vel", "motor.foc.Iq_measured"],
            [("pos_vel_mapper.pos_rel", "motor.foc.Iq_measured")],
        ),
        (
            ["t", *(f"axis{k}.{n}" for k in (0, 1) for n in ("map.vel", "map.pos_rel", "torque"))],
            [(f"axis{k}.map.pos_rel", f"axis{k}.torque") for k in (0, 1)],
        ),
        (["t", "606Ch", "607Ah", "6064h", "6077h"], [("6064h", "6077h")]),
        (["t", "0x6064", "0x6864", "0x6877", "0x6077"], [("0x6064", "0x6077"), ("0x6864", "0x6877")]),
        (["t", "6064:00", "6078:00"], [("6064:00", "6078:00")]),
        (["t", "A1.Moment.Ist", "A1.Position.Ist"], [("A1.Position.Ist", "A1.Moment.Ist")]),
        (["t", "I_q", "theta"], [("theta", "I_q")]),
        (["t", "DriveMotorPosAct_A1", "DriveMotorTorq_Act_A1"],
         [("DriveMotorPosAct_A1", "DriveMotorTorq_Act_A1")]),
        (["t", "0.joint-pos-cmd", "0.joint-pos-fb", "0.torque"], [("0.joint-pos-fb", "0.torque")]),
        (
            ["t", *(n for f in ("AIPos", "ASPos", "MACur", "GearTorque") for n in many(f + ".A{}", 2))],
            [("AIPos.A0", "MACur.A0"), ("AIPos.A1", "MACur.A1")],
        ),
        (
            ["t", *(f"Drive {k}.{n} actual value{c}" for k in (1, 2)
                    for n, c in (("Position", " 1"), ("Position", " 2"), ("Torque", "")))],
            [(f"Drive {k}.Position actual value 1", f"Drive {k}.Torque actual value") for k in (1, 2)],
        ),
        (
            ["t", *(f"servo_{k}.{n}" for k in (1, 2)
                    for n in ("r482[0]: Gn_XIST1", "r80[0]: Torque actual"))],
            [(f"servo_{k}.r482[0]: Gn_XIST1", f"servo_{k}.r80[0]: Torque actual") for k in (1, 2)],
        ),
        (
            ["t", *(f"Axis {k} {n}" for k in (1, 2)
                    for n in ("1718 Motor position", "4947 Torque reference"))],
            [(f"Axis {k} 1718 Motor position", f"Axis {k} 4947 Torque reference") for k in (1, 2)],
        ),
        (
            ["t", "Position(deg) J1", "Current(A) J1", "Disturbance torque(A) J1"],
            [("Position(deg) J1", "Current(A) J1")],
        ),
        (
            ["t", *(f"axis0.{n}" for n in ("encoder.pos_estimate", "motor.current_control.Iq_measured",
                                           "controller.input_pos", "controller.input_torque"))],
            [("axis0.encoder.pos_estimate", "axis0.motor.current_control.Iq_measured")],
        ),
        (
            ["t", "Position actual value (0x6064)", "Torque actual value (0x6077)",
             "Position demand value (0x6062)", "Torque demand (0x6074)"],
            [("Position actual value (0x6064)", "Torque actual value (0x6077)")],
        ),
        (
            ["t", *(f"/jtc/state/{s}/{n}[0]" for s in ("desired", "actual", "error")
                    for n in ("positions", "effort"))],
            [("/jtc/state/actual/positions[0]", "/jtc/state/actual/effort[0]")],
        ),
        (
            ["t", *(f"{k}-axis {n}" for k in "ST"
                    for n in ("feedback pulse", "command pulse", "torque(%)"))],
            [(f"{k}-axis feedback pulse", f"{k}-axis torque") for k in "ST"],
        ),
        (["t", "J1 FB pulse(pls)", "J1 Current FB(%)", "J1 Droop(pls)"],
         [("J1 FB pulse", "J1 Current FB")]),
        (["t", "Axis_1:PCTRL_S_ACT", "Axis_1:ICTRL_ISQ_ACT", "Axis_1:LOAD_TORQUE"],
         [("Axis_1:PCTRL_S_ACT", "Axis_1:ICTRL_ISQ_ACT")]),
        (["t", "link_pos_1", "motor_pos_1", "motor_torque_1"], [("motor_pos_1", "motor_torque_1")]),
        (
            ["timestamp", *(n for f in ("target_q_{}", "target_qd_{}", "target_current_{}",
                                        "target_moment_{}",
                                        "actual_q_{}", "actual_qd_{}", "actual_current_{}",
                                        "joint_control_output_{}", "actual_TCP_pose_{}",
                                        "joint_temperatures_{}")
                            for n in many(f, 6))],
            [(f"actual_q_{k}", f"actual_current_{k}") for k in range(6)],
        ),
        (
            ["pc_ts", *(n for f in ("q_{}", "qd_{}", "tq_{}", "tqd_{}", "tcp_{}") for n in many(f, 6))],
            [("q_0", "")],
        ),
        (["t", "q1", "tq1", "q2", "tq2"], [("q1", "tq1"), ("q2", "tq2")]),
        (
            ["index", "time", *(n for f in ("mp{}", "ip{}", "mt{}", "et{}") for n in many(f, 7, 1))],
            [(f"mp{k}", f"mt{k}") for k in range(1, 8)],
        ),
        (
            ["t", *(f"Axis {k} ({n})" for k in (1, 2)
                    for n in ("SetPos", "ActPos", "PosDiff", "ActVelo", "SetTorque", "ActTorque"))],
            [(f"Axis {k} (ActPos)", f"Axis {k} (ActTorque)") for k in (1, 2)],
        ),
        (
            ["t", *(f"gAxis0{k}:{n}" for k in (1, 2)
                    for n in ("PCTRL_S_SET", "PCTRL_S_ACT", "PCTRL_LAG_ERROR", "SCTRL_SPEED_ACT",
                              "ICTRL_ISQ_REF", "ICTRL_ISQ_ACT", "ICTRL_ISD_ACT"))],
            [(f"gAxis0{k}:PCTRL_S_ACT", f"gAxis0{k}:ICTRL_ISQ_ACT") for k in (1, 2)],
        ),
        (
            ["t", *(f"Axis{k}.{n}" for k in (1, 2)
                    for n in ("stSetpointValues.lrPosition", "stActValues.lrPosition",
                              "stActValues.lrVelocity", "stActValues.lrTorque", "lrLagError"))],
            [(f"Axis{k}.stActValues.lrPosition", f"Axis{k}.stActValues.lrTorque") for k in (1, 2)],
        ),
        (
            ["ms", *(f"{a} axis {n}" for a in "ab" for n in ("reference position", "motor position",
                                                             "position error", "velocity", "torque"))],
            [(f"{a} axis motor position", f"{a} axis torque") for a in "ab"],
        ),
        (
            ["t", *(f"actuators[{k}].{n}" for k in (0, 1)
                    for n in ("jitter_comm", "position", "velocity", "current_motor", "voltage",
                              "temperature_motor"))],
            [(f"actuators[{k}].position", f"actuators[{k}].current_motor") for k in (0, 1)],
        ),
        (
            ["t", *(n for f in ("actual_joint_position[{}]", "actual_joint_velocity[{}]",
                                "actual_motor_torque[{}]", "external_joint_torque[{}]",
                                "target_joint_position[{}]", "target_motor_torque[{}]")
                    for n in many(f, 6))],
            [(f"actual_joint_position[{k}]", f"actual_motor_torque[{k}]") for k in range(6)],
        ),
        (
            ["t", *(f"j{k}.{n}" for k in (1, 2)
                    for n in ("cmdPos", "fbkPos", "trackErr", "fbkVel", "cmdTrq", "fbkTrq"))],
            [(f"j{k}.fbkPos", f"j{k}.fbkTrq") for k in (1, 2)],
        ),
        (
            ["ms", "Servo motor speed", "Droop pulses", "Cumulative feedback pulses",
             "Instantaneous torque", "Bus voltage", "Load inertia moment ratio"],
            [("Cumulative feedback pulses", "Instantaneous torque")],
        ),
        (["Horodatage", "Angle_moteur", "Intensité_moteur", "Tension", "Vitesse_moteur"],
         [("Angle_moteur", "Intensité_moteur")]),
        (["Zeit", "Motorwinkel", "Motorstrom", "Solldrehmoment", "Istdrehzahl"],
         [("Motorwinkel", "Motorstrom")]),
        (["時間", "関節角度1", "関節角速度1", "トルク1", "指令角度1"], [("関節角度1", "トルク1")]),
        (["时间", "关节1位置", "关节1力矩", "关节1速度"], [("关节1位置", "关节1力矩")]),
        (["время", "угол 1", "момент 1", "скорость 1"], [("угол 1", "момент 1")]),
        (["t", "Axis_1.basicmotion.position", "Axis_1.actualtorque.value"],
         [("Axis_1.basicmotion.position", "Axis_1.actualtorque.value")]),
        (["t", "Actual position of axis", "Position error of axis", "Current Phase A [mA]"],
         [("Actual position of axis", "")]),
        (
            ["t", *(f"Actual Joint {n} J1" for n in ("Temperatures", "Positions", "Currents"))],
            [("Actual Joint Positions J1", "Actual Joint Currents J1")],
        ),
        (["t", *(f"ID1 Present {n}" for n in ("Temperature", "Position", "Current"))],
         [("ID1 Present Position", "ID1 Present Current")]),
        (["t", "qfrc_bias[0]", "qvel[0]", "qpos[0]", "qfrc_actuator[0]"],
         [("qpos[0]", "qfrc_actuator[0]")]),
        (["t", "left_w0_velocity", "left_w0_angle", "left_w0_effort"],
         [("left_w0_angle", "left_w0_effort")]),
        (["t", "target", "voltage.q", "voltage.d", "current.q", "current.d", "velocity", "angle"],
         [("angle", "current.q")]),
        (
            ["t", *(f"Drive {k} (AX5).Inputs.{n} actual value" for k in (1, 2)
                    for n in ("Position", "Torque"))],
            [(f"Drive {k} (AX5).Inputs.Position actual value",
              f"Drive {k} (AX5).Inputs.Torque actual value") for k in (1, 2)],
        ),
        (["t", "PL.FB", "PL2.FB", "PL.CMD", "IL.FB", "IL2.FB", "VL.FB"],
         [("PL.FB", "IL.FB"), ("PL2.FB", "IL2.FB")]),
        (["t", "ql_1", "qm_1", "taum_1"], [("qm_1", "taum_1")]),
        (["t", "S-0-0051 Positionsistwert", "S-0-0047 Positionssollwert", "S-0-0084 Drehmomentistwert"],
         [("S-0-0051 Positionsistwert", "S-0-0084 Drehmomentistwert")]),
        (["t", "Rotorposition", "Motormoment gefiltert", "Motormoment"],
         [("Rotorposition", "Motormoment")]),
        # Where nothing fits, the role stays empty.
        (["t", "Axis 1 seq", "Axis 1 frame", "Achse 1 Zähler", "axis1.ntc", "Axis 1 torque"],
         [("", "Axis 1 torque")]),
        (["t", "position gain", "torque constant", "moment of inertia"], [("", "")]),
        (["t", "electrical angle", "friction torque", "tau_gravity", "supply current"], [("", "")]),
        (["t", "tcp position", "position valid", "torque std", "kp_position", "brake torque"],
         [("", "")]),
        (["t", "gAxis1.monitor.v", "gAxis1.torque_act"], [("", "gAxis1.torque_act")]),
        (["t", "theta_md", "tau_m"], [("", "tau_m")]),
        (["t", "Joint Temperatures 1", "Joint Currents 1"], [("", "Joint Currents 1")]),
        (["tick", "ax1_mpos_ref", "ax1_mvel_meas", "ax1_mot_trq_model"], [("", "")]),
        (["t", "position command", "torque"], [("", "torque")]),
        (["t", "torque", "velocity"], [("", "torque")]),
        (["t", "motor speed", "winding temperature"], [("", "")]),
        (["t", "cycle counter", "motor current"], [("", "motor current")]),
        (["t", "angle", "angular velocity"], [("angle", "")]),
        (["t", "motor_position_timestamp", "torque"], [("", "torque")]),
        (["t", "position_error", "torque limit"], [("", "")]),
        (["t", "first [V]", "second [V]"], [("", "")]),
        (["t", "alpha", "beta"], [("", "")]),
        (["t", "one [mm]", "two [rpm]"], [("", "")]),
        (["t", "joint1 position", "data 0", "torque 0", "torque 1"], [("joint1 position", "torque 1")]),
        (["t", "pos0", "pos1", "trq1", "trq2"], [("pos0", "trq1")]),
        (["t", "q", "tau_ext", "tau_meas"], [("q", "tau_meas")]),
        (["t", "q", "tau_ext_hat"], [("q", "")]),
        (["t", "external encoder [deg]", "motor current"], [("external encoder", "motor current")]),
        (["t", "joint_pos_1", "motor_pos_1", "motor_torque_1"], [("motor_pos_1", "motor_torque_1")]),
        (["Zeit", "Motorlage", "Motormoment", "Lastlage"], [("Motorlage", "Motormoment")]),
        (["t", "Pulse S", "Pulse L", "Torque S", "Torque L"],
         [("Pulse S", "Torque S"), ("Pulse L", "Torque L")]),
        (["t", "pos", "rpm", "amps"], [("pos", "amps")]),
        (["tempo", "posição junta 1", "velocidade junta 1", "binário junta 1"],
         [("posição junta 1", "binário junta 1")]),
        (["čas", "poloha osy 1", "rychlost osy 1", "moment osy 1"], [("poloha osy 1", "moment osy 1")]),
        (["zaman", "konum 1", "hız 1", "tork 1"], [("konum 1", "tork 1")]),
    ],
)  # fmt: skip
def test_names_of_controllers(names: list[str], expected: list[tuple[str, str]]) -> None:
    assert pairs(*names) == expected


@pytest.mark.parametrize(
    "name",
    ["dcLink", "dcLink_A1", "axis1.dcLink", "dcLinkCurrent", "DC bus current 1", "Idc1", "i_bus",
     "Zwischenkreisstrom A1", "battery_current"],
)  # fmt: skip
def test_the_electrical_supply_of_a_drive_takes_no_role(name: str) -> None:
    assert pairs("time", "q1", "tau1", name) == [("q1", "tau1")]
    for role in ("q1", "tau1"):
        assert name not in [each for pair in pairs("time", role, name) for each in pair]
    assert pairs("time", "bus1.axis1.position", "bus1.dc_motor.current") == [
        ("bus1.axis1.position", "bus1.dc_motor.current")
    ]


def test_a_rising_position_is_not_proposed_as_time() -> None:
    table = table_named("motor position", "motor torque")  # the first column rises evenly
    assert guess_mapping(table).mapping.time == TimeColumn("", "samples", 1000.0)


def test_a_clock_coarser_than_the_samples_is_not_proposed() -> None:
    table = table_named("time [s]", "position", "torque")
    coarse = replace(table.columns[0], values=np.floor(T * 100) / 100)
    time = guess_mapping(replace(table, columns=(coarse, *table.columns[1:]))).mapping.time
    assert (time.column, time.unit) == ("", "samples")


def test_a_clock_of_seconds_and_nanoseconds_takes_no_role() -> None:
    """As ``ros2 topic echo --csv`` writes it, without names."""
    rng = np.random.default_rng(2)
    seconds, part = np.divmod(np.arange(2000), 500)
    cells = [
        seconds,
        part * 2_000_000,
        np.sin(20 * T),
        np.cos(20 * T) + 1e-3 * rng.standard_normal(2000),
    ]
    rows = ["{:d},{:d},base,{:.9f},{:.9f}".format(*row) for row in zip(*cells, strict=True)]
    (table,) = read_log("\n".join(rows).encode(), "echo.csv")
    (joint,) = guess_mapping(table).mapping.joints
    assert (joint.position.column, joint.torque.column) == ("column 4", "column 5")
    assert "left out: column 3." in table.notes[0]


def test_a_clock_in_two_columns_is_joined_whatever_separates_their_names() -> None:
    names = "/state/stamp/sec,/state/stamp/nanosec,/state/j1/position,/state/j1/effort\n"
    rows = [
        f"{170 + k // 500},{k % 500 * 2_000_000},{np.sin(k / 25)},{np.cos(k / 25)}" for k in range(2000)
    ]
    (table,) = read_log((names + "\n".join(rows)).encode(), "plot.csv")
    log = apply_mapping(table, guess_mapping(table).mapping)
    assert np.allclose(log.time_s, np.arange(2000) * 2e-3, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("step", "sure"), [(0.01, True), (0.1, False)])
def test_steps_that_two_units_fit_are_to_be_confirmed(step: float, sure: bool) -> None:
    table = table_named("time", "position", "torque")
    clock = replace(table.columns[0], values=np.arange(2000) * step)
    guess = guess_mapping(replace(table, columns=(clock, *table.columns[1:])))
    assert guess.mapping.time == TimeColumn("time", "s")
    assert ("unit of time" not in {reason.what for reason in unsure(guess)}) == sure


def test_positions_behind_the_gear_are_proposed_beside_those_of_the_motor() -> None:
    for behind, motor in (
        ("link_pos_{}", "motor_pos_{}"),
        ("q{}", "theta{}"),
        ("axis{}_secondary_encoder", "axis{}_motor_position"),
    ):
        names = [f.format(k) for k in (1, 2) for f in (behind, motor, "motor_torque_{}")]
        guess = guess_mapping(table_named("t", *names)).mapping
        assert [j.position.column for j in guess.joints] == [motor.format(k) for k in (1, 2)]
        assert [j.arm.column for j in guess.joints if j.arm] == [behind.format(k) for k in (1, 2)]
        assert mapping_from_json(mapping_to_json(guess)) == guess
        assert {f"gear ratio of joint {k}" for k in (1, 2)} <= {*guess.assumed}


def test_positions_that_move_as_the_sensor_behind_the_gear_are_at_the_joint() -> None:
    """The "motor position" of some controllers is the motor's angle over the gear ratio, in degrees."""
    names = ["axis1_secondary_encoder_deg", "axis1_motor_position_deg", "motor_torque_1"]
    for ratio, found in ((1.001, ("joint", False)), (250.0, ("motor", True))):
        table = table_named("t", *names)
        clock, behind, *others = table.columns
        motor = replace(others[0], values=ratio * behind.values)
        guess = guess_mapping(replace(table, columns=(clock, behind, motor, *others[1:])))
        confirm = "side of position of joint 1" in {reason.what for reason in unsure(guess)}
        assert (guess.mapping.joints[0].position.side, confirm) == found


def test_joints_without_a_second_sensor_are_measured_as_those_with_one() -> None:
    names = [f"axis{k}_motor_{what}" for k in (1, 2) for what in ("position_deg", "torque")]
    table = table_named("t", *names)
    behind = replace(table.columns[1], name="axis1_secondary_encoder")
    guess = guess_mapping(replace(table, columns=(*table.columns, behind)))
    assert [joint.position.side for joint in guess.mapping.joints] == ["joint", "joint"]
    assert "side of position of joint 2" in {reason.what for reason in unsure(guess)}


def test_positions_without_a_unit_share_one() -> None:
    """A small motion of one joint does not make it radians beside others in degrees."""
    table = table_named("t", "jPos[0]", "jPos[1]", "nTorque[0]", "nTorque[1]")
    large = LogColumn("jPos[1]", numbers(40 * table.column("jPos[1]").values))
    table = LogTable("log", tuple(large if c.name == "jPos[1]" else c for c in table.columns))
    assert [j.position.unit for j in guess_mapping(table).mapping.joints] == ["deg", "deg"]


def test_durations_as_matlab_writes_them() -> None:
    rows = [f"{1e-3 * k:.3f} sec,{np.sin(k):.6f},{np.cos(k):.6f}" for k in range(200)]
    (table,) = read_log("\n".join(["Time,q,tau", *rows]).encode(), "timetable.csv")
    np.testing.assert_allclose(table.column("Time").values, 1e-3 * np.arange(200), atol=1e-9)
    assert table.column("Time").unit == "s"


def test_degrees_as_kuka_writes_them() -> None:
    joint = guess_mapping(
        table_named("t", "Istposition A1 [grd]", "Motormoment A1 [Nm]")
    ).mapping.joints[0]
    assert (joint.position.column, joint.position.unit) == ("Istposition A1", "deg")


def test_objects_of_cia_402_are_thousandths_of_the_rated_torque() -> None:
    joint = guess_mapping(table_named("t", "6064h", "6077h")).mapping.joints[0]
    assert joint.torque.unit == "‰"
    assert joint.torque.side == "motor"


@pytest.mark.parametrize(
    ("name", "values", "unit", "why"),
    [
        ("Drive 1.Torque actual value", [0, -120, 35], "‰", 'CiA 402\'s name "Torque actual value"'),
        ("Drive 1.Torque actual value", [0, -1.2, 3.5], "N·m", "not whole numbers"),
        ("Drive 1.Torque actual value", [0, 0, 0], "N·m", "not whole numbers"),
        ("Drive 1.Torque", [0, -120, 35], "N·m", "may be raw values, such as ‰"),
        ("Drive 1.Torque", [0, -12.5, 35], "N·m", "newton metres are assumed."),
    ],
)
def test_whole_numbers_of_a_torque_named_as_in_cia_402_are_thousandths(
    name: str, values: list[float], unit: str, why: str
) -> None:
    found, stated, reason = guess_unit("torque", LogColumn(name, np.array(values, float)))
    assert (found, stated) == (unit, False)
    assert why in reason


def test_more_joints_than_the_limit_are_a_valid_mapping() -> None:
    guess = guess_mapping(table_named("t", *many("q{}", 25), *many("tau{}", 25)))
    assert guess.mapping.n == 20
    assert "25 pairs" in next(r.text for r in guess.reasons if r.what == "joints")


# --- unnamed columns


def motion() -> tuple[np.ndarray, ...]:
    """Two swept angles with their velocities and torques."""
    phase = 2 * np.pi * (1 + 3 * T) * T
    q = [(0.3 + 0.1 * k) * np.sin(phase + k) for k in (0, 1)]
    dq = [np.gradient(x, T) for x in q]
    rng = np.random.default_rng(3)
    tau = [1e-2 * np.gradient(v, T) + 1e-3 * rng.standard_normal(T.size) for v in dq]
    return (*q, *dq, *tau)


@pytest.mark.parametrize("layout", ["q q dq dq tau tau", "q dq tau q dq tau", "q tau q tau"])
@pytest.mark.parametrize("clock", ["first", "last", "with a counter"])
def test_a_clock_inside_a_matrix_and_velocities_take_no_role(layout: str, clock: str) -> None:
    q0, q1, v0, v1, t0, t1 = motion()
    signals = {
        "q q dq dq tau tau": [q0, q1, v0, v1, t0, t1],
        "q dq tau q dq tau": [q0, v0, t0, q1, v1, t1],
        "q tau q tau": [q0, t0, q1, t1],
    }[layout]
    around = {
        "first": [T, *signals],
        "last": [*signals, T],
        "with a counter": [T, *signals, np.arange(2000.0)],
    }
    (table,) = read_log(make.matrix(around[clock]), "log.txt")
    guess = guess_mapping(table).mapping
    assert table.column(guess.time.column).values == pytest.approx(T)
    found = [(table.column(j.position.column), table.column(j.torque.column)) for j in guess.joints]
    for (position, torque), (q, tau) in zip(found, ((q0, t0), (q1, t1)), strict=True):
        assert position.values == pytest.approx(q, rel=1e-7)
        assert torque.values == pytest.approx(tau, rel=1e-7)


def test_columns_of_one_array_are_unnamed_unless_its_name_is_a_quantity() -> None:
    q0, q1, _, _, t0, t1 = motion()
    buffer = io.BytesIO()
    np.save(buffer, np.column_stack([T, q0, t0, q1, t1]))
    (table,) = read_log(buffer.getvalue(), "log.npy")
    joints = guess_mapping(table).mapping.joints
    assert [(j.position.column, j.torque.column) for j in joints] == [
        ("array 2", "array 3"),
        ("array 4", "array 5"),
    ]
    assert pairs("t", *many("torque {}", 4)) == [("", "torque 0")]


@pytest.mark.parametrize("layout", ["q q i i tau tau", "q tau i"])
def test_currents_beside_torques_leave_the_roles_of_a_matrix_open(layout: str) -> None:
    """Which block holds the torque cannot be seen: nothing is proposed."""
    q0, q1, _, _, t0, t1 = motion()
    rng = np.random.default_rng(4)
    currents = [t + 1e-3 * rng.standard_normal(t.size) for t in (t0, t1)]
    signals = [q0, q1, *currents, t0, t1] if "q q" in layout else [q0, q1, t0, t1, currents[0]]
    (table,) = read_log(make.matrix([T, *signals]), "log.txt")
    guess = guess_mapping(table).mapping
    assert guess.open_roles == ("position of joint 1", "torque of joint 1")


@pytest.mark.parametrize("name", ["current_pos_x", "torque_z", "tool.position.y", "pos x"])
def test_a_point_or_a_wrench_is_not_proposed_as_a_joint(name: str) -> None:
    guess = guess_mapping(table_named("t", name, "joint_1", "v2")).mapping
    assert name not in guess.columns
    axis = described(LogColumn("X_ActPos", T))
    assert axis.score["position"] > 0


# --- several clocks


def two_clocks(shift_s: float = 0.0, *, turn: float = 0.0) -> LogTable:
    """An angle at 1 kHz and a torque at 411 Hz in rows of their own."""
    fast, slow = np.arange(0, 6, 1e-3), np.arange(0.0002, 6, 1 / 411) + shift_s
    time = np.sort(np.concatenate([fast, slow]))
    q, tau = np.full(time.size, np.nan), np.full(time.size, np.nan)
    angle = 0.4 * np.sin(2 * np.pi * 9.7 * fast)
    q[np.searchsorted(time, fast)] = np.mod(angle, turn) if turn else angle
    tau[np.searchsorted(time, slow)] = 0.7 * np.cos(2 * np.pi * 9.7 * slow)
    columns = [LogColumn("t", numbers(time), "s"), LogColumn("q", numbers(q), "rad")]
    return LogTable("log", (*columns, LogColumn("tau", numbers(tau), "N·m")))


@pytest.mark.parametrize("turn", [0.0, 2 * np.pi])
def test_signals_with_their_own_clocks_keep_amplitude_and_phase(turn: float) -> None:
    """The slowest clock stays, so that no sample counts twice; the sine of the other is kept to 1e-5."""
    table = two_clocks(turn=turn)
    log = apply_mapping(table, guess_mapping(table).mapping)
    assert log.time_s.size == pytest.approx(6 * 411, abs=2)
    assert "interpolated" in log.notes[-1].lower()
    assert '"q"' in log.notes[-1]
    record = SineRecord(9.7, log.time_s, log.theta_rad, log.tau_Nm)
    phasors = extract_phasors([record])
    ratio = complex(phasors.q[0, 0] / phasors.tau[0, 0])
    assert ratio == pytest.approx(0.4 / 0.7 * -1j, abs=1e-5)


def test_pauses_are_not_interpolated_and_a_held_torque_keeps_its_value() -> None:
    table = two_clocks()
    time = table.column("t").values
    kept = (time < 2) | (time > 3) | np.isfinite(table.column("tau").values)
    cut = LogTable(
        "log", tuple(LogColumn(c.name, numbers(c.values[kept]), c.unit) for c in table.columns)
    )
    log = apply_mapping(cut, guess_mapping(cut).mapping)
    assert not np.any((log.time_s > 2.01) & (log.time_s < 2.99))
    joint = JointMapping(Channel("q", "rad"), Channel("tau", "N·m"))
    held = Mapping(TimeColumn("t", "s"), (joint,), torque_hold=True)
    swapped = LogTable(
        "log",
        (
            table.columns[0],
            LogColumn("tau", table.columns[1].values, "N·m"),
            LogColumn("q", table.columns[2].values),
        ),
    )
    log = apply_mapping(swapped, held)
    fast = np.isfinite(table.column("q").values)
    known = set(table.column("q").values[fast].tolist())
    assert set(log.tau_Nm[:, 0].tolist()) <= known
    assert "held torque by its last value" in log.notes[-1]


# --- no dead end


def open_log() -> bytes:
    lines = [f"{t},{v},{x}" for t, v, x in zip(TIME_S, TORQUE, ANGLE, strict=True)]
    return "\n".join(["t,velocity,abc", *lines, ""]).encode()


def test_convert_writes_an_open_guess_and_asks_for_its_columns(tmp_path: Path) -> None:
    log, mapping, inertia = tmp_path / "run.csv", tmp_path / "map.json", tmp_path / "robot.toml"
    log.write_bytes(open_log())
    inertia.write_text("[inertia]\nM = [0.01]\nM2 = [[0.02]]\n")
    run = CliRunner().invoke(app, ["convert", str(log), "--guess", str(mapping)])
    assert run.exit_code == 0, run.output
    written = json.loads(mapping.read_text("utf-8"))
    assert written["joints"][0]["position"]["column"] == ""
    options = ["--mapping", str(mapping), "--inertia", str(inertia), "--output", str(tmp_path / "new")]
    run = CliRunner().invoke(app, ["convert", str(log), *options])
    assert run.exit_code != 0
    told = " ".join(run.output.split())
    assert (
        "no column is chosen for position of joint 1, torque of joint 1. Choose one of: velocity, abc"
        in told
    )


@pytest.mark.parametrize("name", [b"axis0.pos_vel_mapper.pos_rel", b"ODrive 0 Position"])
def test_positions_of_odrive_are_turns_to_be_confirmed(name: bytes) -> None:
    (table,) = read_log(
        b"t,%s,torque\n" % name + b"".join(b"%d,0.%d,%d\n" % (k, k % 7, k % 5) for k in range(60)),
        "log.csv",
    )
    guess = guess_mapping(table)
    assert guess.mapping.joints[0].position.unit == "rev"
    assert guess.mapping.joints[0].position.side == "motor"
    assert "unit of position of joint 1" in {reason.what for reason in unsure(guess)}
