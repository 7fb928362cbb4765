"""How far the answer can be trusted: inertias, resampling, poses, prediction."""
