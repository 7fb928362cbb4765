"""Gears: laws of their torque over deflection, and measured torsion curves."""
