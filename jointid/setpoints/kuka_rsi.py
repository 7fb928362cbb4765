"""KUKA RobotSensorInterface: axis corrections in degrees for a program that streams them."""

from jointid.setpoints.file_format import Format, table

FORMAT = Format(
    name="rsi",
    title="KUKA RSI",
    ending=".rsi.csv",
    write=lambda points: table(points, "cycle", "A#_deg", 7),
    intervals_ms=(4.0, 12.0),
    axes=(4, 5, 6),
    degrees=True,
    from_start=True,
    notes=(
        "RSI: corrections of the axes in degrees, relative to the pose at RSI_ON(#ABSOLUTE); with",
        "#RELATIVE they would add up. 4 ms for IPO_FAST, 12 ms for IPO. One row per telegram, with its",
        "IPOC. Set the limits of AXISCORR and AXISCORRMON just above the ranges below.",
        "RSI bypasses path planning of the controller; corrections act in T1 as well.",
    ),
)
