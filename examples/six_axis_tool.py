"""How far a force of 100 N moves the tool of a six-axis robot, pose by pose."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from jointid import Elasticity, RobotModel
from jointid.cut.tool_stiffness import tool_stiffness

ROBOT = Path(__file__).parents[1] / "sample_data" / "six_axis_robot.toml"
K_JOINT = np.array([5.0e6, 7.5e6, 4.2e6, 1.3e6, 1.1e6, 0.4e6])  # N·m/rad
POSES_DEG = {
    "stretched": [0, -20, 20, 0, 10, 0],
    "folded": [0, -90, 120, 0, 45, 0],
    "to the side": [60, -45, 80, 0, 45, 0],
}


def main() -> None:
    robot = RobotModel.load(ROBOT)
    springs = Elasticity(K=K_JOINT / robot.gear_ratio**2, D=np.full(6, 0.1))
    print("pose          worst direction      100 N move it    resonances, motors locked")
    for name, degrees in POSES_DEG.items():
        tool = tool_stiffness(robot, np.radians(degrees), springs)
        compliance, directions = tool.principal
        axis = " ".join(f"{x:+.2f}" for x in directions[0])
        frequencies = ", ".join(f"{f:.1f}" for f in tool.resonances_hz[:3])
        print(f"{name:12}  {axis}    {1e5 * compliance[0]:8.3f} mm    {frequencies} Hz, …")


if __name__ == "__main__":
    main()
