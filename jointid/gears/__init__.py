"""Gears: laws of their torque over wind-up, and measured torsion curves."""
