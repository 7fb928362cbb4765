"""Cramér–Rao bound of K, D and the inertias with their prior, from the equations of motion alone."""

from __future__ import annotations

import numpy as np

from benchmarks.independent_robot import Array, Experiment, Robot, steady_state


def impedance(s: Array, M: Array, M2: Array, K: Array, D: Array) -> Array:
    """Motor torque over motor angle, shape (r, n, n), at s = iω, shape (r,)."""
    gear = (K + s[:, None] * D)[:, :, None] * np.eye(K.size)
    square = (s**2)[:, None, None]
    return square * np.diag(M) + gear - gear @ np.linalg.solve(square * M2 + gear, gear)


def bound(robot: Robot, experiment: Experiment, given_M: Array, given_M2: Array, std: float) -> Array:
    """Smallest standard errors of K and D, shape (2n,), when M and M2 are given with a relative ``std``.

    The noise is that of the experiment: white torque noise and an encoder's steps. The true amplitudes
    are nuisance parameters, so the residual of the motors' equations of motion counts in each record.
    """
    n = robot.n
    rows, columns = np.tril_indices(n)

    def torque(p: Array) -> Array:
        M2 = np.zeros((n, n))
        M2[rows, columns] = M2[columns, rows] = p[3 * n :]
        return (impedance(s, p[2 * n : 3 * n], M2, p[:n], p[n : 2 * n]) @ q[:, :, None])[:, :, 0]

    s = 2j * np.pi * experiment.frequency_hz
    q, tau, _ = steady_state(robot, experiment)
    truth = np.concatenate([robot.K, robot.D, robot.M, robot.M2[rows, columns]])
    own = np.sqrt(np.diag(given_M2))
    unit = np.maximum(np.abs(given_M2), 0.1 * np.outer(own, own))[rows, columns]
    scale = np.concatenate([robot.K, robot.D, given_M, unit])
    J = np.empty((s.size, n, truth.size), complex)
    for k, size in enumerate(scale):
        step = np.zeros(truth.size)
        step[k] = 1e-5 * size
        J[:, :, k] = (torque(truth + step) - torque(truth - step)) / 2e-5  # per relative change
    samples = np.ceil(experiment.periods / experiment.frequency_hz * experiment.sample_rate_hz)
    per_sample = 4 / samples[:, None, None] * np.eye(n)
    Z = impedance(s, robot.M, robot.M2, robot.K, robot.D)
    step_rad = 2 * np.pi / experiment.encoder_counts if experiment.encoder_counts else 0.0
    noise = (experiment.noise * np.abs(tau)) ** 2
    C = noise[:, :, None] * per_sample + Z @ (step_rad**2 / 12 * per_sample) @ Z.conj().swapaxes(1, 2)
    information = 2 * np.einsum("rak,ral->kl", J.conj(), np.linalg.solve(C, J)).real
    if np.isfinite(std):
        information[np.arange(2 * n, truth.size), np.arange(2 * n, truth.size)] += 1 / std**2
    return np.sqrt(np.diag(np.linalg.inv(information))[: 2 * n]) * scale[: 2 * n]
