"""Experiments as joint set points: motion, check on the simulated robot, files for controllers."""
