"""The same parameters by MuJoCo's own system identification, mujoco.sysid.

Its best use, found by trial: sliding joints (the model is linear, an angle is as good as a length), the
coupling inertia as a mass that both arm coordinates move, a fixed tendon as the spring, friction loss
and damping on the motors; RK4, which here is the most accurate of its integrators, the friction
constraint stiffer than by default; its own optimiser with scaled columns and logarithmic parameters. Its
own residual is a plain difference of sensors, which drifts away in open loop; so the same high-pass
filter, averaging and initial states as in the time-domain fit are supplied through its hooks.
"""

from __future__ import annotations

import io
import logging
from collections.abc import Callable
from functools import partial
from typing import Any

import mujoco
import numpy as np
from mujoco import sysid
from scipy.signal import sosfilt

from benchmarks.grey_box_time import AVERAGED, TimeData
from jointid import Inertia

if not hasattr(sysid, "optimize"):  # it swallows the error of its own missing libraries
    raise ImportError("mujoco.sysid is empty: its extra is missing, install mujoco[sysid]")

SPAN = np.log(30.0)
"""Of the bounds; farther out its integrator becomes unstable, and the toolbox raises an error."""
NAMES = ("K1", "K2", "D1", "D2", "Fc1", "Fc2", "Fv1", "Fv2")
MASSES = ("m1", "m2", "a1", "a2", "armature")


def model(inertia: Inertia, interval_s: float) -> mujoco.MjSpec:
    """Rotors and arm with the motor-side inertias; its parameters are set later."""
    (a, c), (_, b) = inertia.M2
    if not 0 < c < min(a, b):
        raise ValueError("The coupling inertia must be positive and below both arm inertias.")

    def body(name: str, mass: float, armature: float = 0.0, inside: str = "") -> str:
        return (
            f'<body name="{name}"><inertial pos="0 0 0" mass="{mass}" diaginertia="1 1 1"/>'
            f'<joint name="{name}" type="slide" axis="1 0 0" armature="{armature}" '
            f'solreffriction="{2 * interval_s} 1" solimpfriction=".99 .9999 1e-4"/>{inside}</body>'
        )

    arm = body("a1", a - c, inside=body("a2", c, armature=b - c))
    springs = "".join(
        f'<fixed name="s{j}" springlength="0"><joint joint="m{j}" coef="1"/>'
        f'<joint joint="a{j}" coef="-1"/></fixed>'
        for j in (1, 2)
    )
    motors = "".join(f'<motor name="m{j}" joint="m{j}"/>' for j in (1, 2))
    sensors = "".join(f'<jointpos name="m{j}" joint="m{j}"/>' for j in (1, 2))
    return mujoco.MjSpec.from_string(
        f'<mujoco><option timestep="{interval_s}" gravity="0 0 0" integrator="RK4">'
        '<flag contact="disable"/></option><worldbody>'
        f"{body('m1', inertia.M[0])}{body('m2', inertia.M[1])}{arm}</worldbody>"
        f"<tendon>{springs}</tendon><actuator>{motors}</actuator><sensor>{sensors}</sensor></mujoco>"
    )


def _modifiers() -> list[Callable[[mujoco.MjSpec, Any], None]]:
    """How each parameter enters the model."""

    def into(kind: str, name: str, attribute: str, spec: mujoco.MjSpec, p: Any) -> None:
        part = getattr(spec, kind)(name)
        old = getattr(part, attribute)
        value = float(np.exp(p.value[0]))
        if np.ndim(old):  # polynomial coefficients, of which the first is the linear one
            new = np.zeros_like(old)
            new.flat[0] = value
            setattr(part, attribute, new)
        else:
            setattr(part, attribute, value)

    kinds = [("tendon", "s", "stiffness"), ("tendon", "s", "damping")]
    kinds += [("joint", "m", "frictionloss"), ("joint", "m", "damping")]
    found = [partial(into, kind, f"{letter}{j}", a) for kind, letter, a in kinds for j in (1, 2)]
    found += [partial(into, "body", name, "mass") for name in MASSES[:4]]
    return [*found, partial(into, "joint", "a2", "armature")]


def fit(data: TimeData, inertia: Inertia, start: np.ndarray, iterations: int = 15) -> np.ndarray:
    """K1, K2, D1, D2, Fc1, Fc2, Fv1, Fv2; more iterations change them by less than a thousandth.

    A start of 13 values leaves the inertias free; theirs follow in the order of ``grey_box_time``.
    """
    logging.getLogger("absl").setLevel(logging.ERROR)
    masses = (
        [*start[8:10], start[10] - start[12], start[12], start[11] - start[12]] if start[8:].size else []
    )
    x0 = np.log(np.maximum([*start[:8], *masses], 1e-6))
    params = sysid.ParameterDict()
    named = list(zip((*NAMES, *MASSES), _modifiers(), strict=True))[: x0.size]
    for (name, modifier), value in zip(named, x0, strict=True):
        params.add(sysid.Parameter(name, value, value - SPAN, value + SPAN, modifier=modifier))
    residual = residual_of(data, inertia)
    found, _ = sysid.optimize(
        params,
        residual,
        optimizer="mujoco",
        verbose=False,  # it prints every iteration all the same
        output=io.StringIO(),
        x_scale="jac",
        max_iters=iterations,
        xtol=1e-4,
    )
    p = np.exp(found.as_vector())
    if p.size > 8:
        p[10:] = p[10] + p[11], p[12] + p[11], p[11]
    return p


def residual_of(data: TimeData, inertia: Inertia) -> Callable[..., Any]:
    """The residual of all records, one group per record: their filters and states differ."""
    spec = model(inertia, data.interval_s)
    compiled = spec.compile()
    parts = []
    for r, (b, e) in enumerate(zip(data.begin, data.begin[1:], strict=False)):
        times = data.interval_s * np.arange(e - b)
        state = sysid.create_initial_state(compiled, np.zeros(4), np.zeros(4))
        sequences = sysid.ModelSequences(
            f"record{r}",
            spec,
            "measured",
            state,
            sysid.TimeSeries(times, data.tau[b:e]),  # its rollout leaves out the last one
            sysid.TimeSeries.from_names(times[1:], data.theta[b + 1 : e], compiled),
        )
        parts.append(
            sysid.build_residual_fn(
                models_sequences=[sequences],
                resample_true=False,
                modify_residual=partial(_difference, data, r),
                custom_rollout=partial(_rollout, data, r),
            )
        )

    def residual(x: np.ndarray, params: Any) -> tuple[list[np.ndarray], None, None]:
        return [each(x, params)[0][0] for each in parts], None, None

    return residual


def _rollout(data: TimeData, r: int, *, initial_states: Any, param_dicts: Any, **rest: Any) -> Any:
    """Each point starts from the state that its own friction implies."""
    started = []
    for state, params in zip(initial_states, param_dicts, strict=True):
        moved = np.array(state)
        moved[1:9] = data.initial[r] @ np.concatenate([[1.0], np.exp(params.as_vector()[4:8])])
        started.append(moved)
    return sysid.sysid_rollout(initial_states=started, **rest)


def _difference(
    data: TimeData, r: int, _params: Any, predicted: Any, measured: Any, *_: Any, state: Any, **__: Any
) -> Any:
    # MuJoCo's sensors are those before the step; the state after it is what the log shows next.
    apart = state[:, 1:3] - measured.data
    passed = sosfilt(data.filters[r], apart - apart[0], axis=0)[data.skip[r] :]
    rows = len(passed) // AVERAGED
    mean = passed[: rows * AVERAGED].reshape(rows, AVERAGED, 2).mean(axis=1)
    scale = np.sqrt((measured.data**2).mean(axis=0))
    return mean / scale, predicted, predicted
