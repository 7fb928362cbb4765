"""ABB Externally Guided Motion: joint angles in degrees for a program that streams them."""

from jointid.setpoints.file_format import Format, table

FORMAT = Format(
    name="egm",
    title="ABB EGM",
    ending=".egm.csv",
    write=lambda points: table(points, "seqno", "joint_#_deg", 7),
    intervals_ms=(4.0, 8.0, 12.0, 16.0, 20.0, 24.0),
    axes=(6, 7),
    degrees=True,
    notes=(
        "EGM: joint angles in degrees for planned.joints of EgmSensor, one row per message. EGMActJoint",
        "with \\SampleRate as the interval here and \\MaxSpeedDeviation above the largest velocities,",
        "then EGMRunJoint. Its filter and gain change amplitudes; the log shows which.",
        "EGM bypasses path planning and collision supervision of the controller.",
    ),
)
