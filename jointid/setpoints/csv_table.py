"""CSV: the angles of all axes, rad."""

from jointid.setpoints.file_format import Format, table

FORMAT = Format("csv", "CSV", ".csv", lambda points: table(points, "sample", "axis_#_rad", 9))
