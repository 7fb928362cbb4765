"""The simulated robot: a closed-loop sine experiment with known K and D."""
