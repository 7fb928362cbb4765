"""Checks of the answer: inertias, resampling, poses, prediction."""
