"""Robots of six axes for tests: our own numbers, in the class of a heavy industrial robot."""

from __future__ import annotations

from pathlib import Path

SIX_AXES = (Path(__file__).parents[1] / "sample_data" / "six_axis_robot.toml").read_text("utf-8")

URDF = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <link name="upper">
    <inertial><origin xyz="0.1 0.02 0.2" rpy="0.1 0.2 0.3"/><mass value="20"/>
      <inertia ixx="1.2" iyy="1.1" izz="0.4" ixy="0.1" ixz="0.02" iyz="-0.05"/></inertial>
    <visual><geometry><mesh filename="package://nowhere/upper.stl"/></geometry></visual>
  </link>
  <link name="fore">
    <inertial><origin xyz="0.2 0 0"/><mass value="9"/>
      <inertia ixx="0.1" iyy="0.5" izz="0.5" ixy="0" ixz="0.01" iyz="0"/></inertial>
  </link>
  <link name="slide"><inertial><mass value="3"/>
    <inertia ixx="0.02" iyy="0.02" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="tool"><inertial><origin xyz="0 0 0.1"/><mass value="2"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="j1" type="revolute"><origin xyz="0 0 0.4" rpy="0.3 0 0"/><axis xyz="0 1 1"/>
    <parent link="base"/><child link="upper"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <joint name="j2" type="continuous"><origin xyz="0.3 0 0.5" rpy="0 0.2 1"/><axis xyz="0 1 0"/>
    <parent link="upper"/><child link="fore"/></joint>
  <joint name="j3" type="prismatic"><origin xyz="0.4 0 0"/><axis xyz="1 0 0"/>
    <parent link="fore"/><child link="slide"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/></joint>
  <joint name="flange" type="fixed"><origin xyz="0.1 0 0" rpy="0 1.57 0"/>
    <parent link="slide"/><child link="tool"/></joint>
  <transmission name="t2"><joint name="j2"/><actuator name="m2">
    <mechanicalReduction>-80</mechanicalReduction></actuator></transmission>
</robot>"""

MJCF = """<mujoco model="arm">
  <compiler angle="degree" meshdir="meshes"/>
  <option gravity="0 0.3 -9.7"/>
  <default><joint armature="40"/>
    <default class="wrist"><joint armature="5" axis="0 1 0"/></default></default>
  <asset><mesh name="shell" file="/nowhere/shell.stl"/></asset>
  <worldbody><light pos="0 0 3"/><geom type="plane" size="1 1 1"/>
    <body name="upper" pos="0 0 0.4" euler="10 20 30">
      <inertial pos="0.1 0 0.2" mass="20" diaginertia="1.2 1.1 0.4" quat="0.9 0.1 0.2 0"/>
      <joint name="j1" axis="0 1 1" pos="0.05 0.1 0" ref="15"/>
      <geom type="mesh" mesh="shell"/>
      <body name="fore" pos="0.3 0 0.5" childclass="wrist">
        <joint name="j2"/><geom type="box" size="0.1 0.2 0.3" mass="9"/>
        <body name="slide" pos="0.4 0 0"><joint name="j3" type="slide" axis="1 1 0"/>
          <inertial pos="0.05 0 0" mass="3" fullinertia="0.02 0.03 0.03 0.001 0.002 0"/></body>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="j1" gear="100"/><motor joint="j2" gear="-50"/>
    <motor joint="j3" gear="30"/></actuator>
</mujoco>"""
