"""Rigid models of robots: torque, inertia and gravity stiffness from a description file."""
