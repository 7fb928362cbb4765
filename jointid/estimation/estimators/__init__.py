"""Estimators of K, D and all that is fitted with them: linear least squares and maximum likelihood."""
