"""Estimators of K, D and the parameters fitted with them: linear least squares, maximum likelihood."""
