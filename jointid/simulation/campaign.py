"""Records of a robot with errors in its given inertias, without and with a known payload."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from jointid.arrays import whole_number
from jointid.errors import JointIdError
from jointid.joints import Elasticity, Inertia
from jointid.records import MotionRecord, SineRecord
from jointid.simulation.closed_loop import simulate_motion, simulate_records
from jointid.simulation.motion import Motion

LOADED = "loaded"
"""Pose of the records with the payload."""


class Campaign(NamedTuple):
    """Records, and the inertias that a study of them is given."""

    records: tuple[SineRecord | MotionRecord, ...]
    inertia: Inertia
    poses: dict[str, Inertia]


def simulate_campaign(
    inertia: Inertia,
    elasticity: Elasticity,
    experiment: ArrayLike | Motion,
    *,
    inertia_error: float = 0.0,
    added: ArrayLike | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    **settings: Any,
) -> Campaign:
    """Simulate the records of a study, with the errors that given inertias have.

    ``experiment`` holds the frequencies of the sines, shape (f,), Hz, or is another motion;
    ``inertia_error`` is the share by which the given inertias differ from the robot's, see
    ``with_inertia_error``. With ``added``, the addition of a payload to M2, shape (n, n), kg·m², all
    experiments are made a second time with it, as records of the pose "loaded", and it is given exactly.
    ``seed`` is that of the noise and of the signs of ``inertia_error``; ``progress`` is called with the
    fraction done, up to 1.0; ``settings`` are further ones of ``simulate_records`` or
    ``simulate_motion``.

    Raises JointIdError when the settings do not fit the robot.
    """
    seed = whole_number("seed", seed, 0)
    given = with_inertia_error(inertia, inertia_error, seed)
    robots = {None: inertia} | ({} if added is None else {LOADED: inertia.with_added(added)})
    records: list[SineRecord | MotionRecord] = []
    for k, (pose, robot) in enumerate(robots.items()):

        def report(done: float, before: int = k) -> None:
            if progress is not None:
                progress((before + done) / len(robots))

        own = seed if pose is None else int(np.random.SeedSequence(seed).generate_state(1)[0])
        settings |= {"pose": pose, "seed": own, "progress": report}
        simulate: Any = simulate_motion if isinstance(experiment, Motion) else simulate_records
        records += simulate(robot, elasticity, experiment, **settings)
    poses = {} if added is None else {LOADED: given.with_added(added)}
    return Campaign(tuple(records), given, poses)


def with_inertia_error(inertia: Inertia, error: float, seed: int = 0) -> Inertia:
    """Return the inertia with every rotor and arm inertia off by a share, up or down at random.

    A coupling inertia is off by the geometric mean of the factors of its two joints, so that M2 stays
    positive definite; ``inertia.added`` stays exact. Raises JointIdError when the share is not in 0 to
    below 1.
    """
    if not 0 <= error < 1:
        raise JointIdError(f"inertia_error = {error!r:.40}: expected 0 ≤ relative error < 1.")
    signs = np.random.default_rng([seed, inertia.n]).choice([-1.0, 1.0], (2, inertia.n))
    factor = 1 + error * signs
    rest = (inertia.M2 - inertia.added) * np.sqrt(np.outer(factor[1], factor[1]))
    return replace(inertia, M=inertia.M * factor[0], M2=rest + inertia.added)
