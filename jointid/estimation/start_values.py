"""Start values for a fit that does not converge from those of the linear estimator."""

import numpy as np

from jointid.arrays import Floats
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.parameters import Block, ParameterLayout, Parameters
from jointid.gears.gear import Gear
from jointid.gears.law_regression import law_by_regression
from jointid.phasors.extract import Phasors

_DAMPED = 0.05
"""D ω over K of a start."""
_ROUGH = 0.1
"""Start values of a fit of gear laws: damping over stiffness, and hysteresis over the largest torque and
deflection."""
_WIDE, _NARROW, _SHARP = 0.3, 0.03, 2e-3
"""Width of a loop, over the largest deflection, for a spring, a usual loop and mere friction, and the
levels of the last two over the largest torque."""
_KNEES = (0.5, 0.3), (0.2, 0.3)
"""Deflections at changes of slope over the largest: other starts of a gear with three slopes."""
_COINCIDE, _APART = 0.05, 0.5
"""Ratio of two deflections, up to the first change of slope and from there to the second, below which
one change is superfluous; and ratio for a start."""


def at_resonances(
    phasors: Phasors, prior: InertiaPrior, *, friction: Parameters | None = None
) -> list[Parameters]:
    """K with the arm's resonance at frequencies of the records, a small D, and a given friction."""
    own = np.diagonal(prior.M2[prior.pose], axis1=1, axis2=2).mean(axis=0)  # M2jj, kg·m²
    layout, starts = ParameterLayout.of(phasors.n, friction=friction is not None), []
    known = {name: friction[name] for name in ("coulomb", "viscous")} if friction else {}
    for share in (0.5, 1.0, 0.0):
        omega = float(np.quantile(phasors.excited, share))
        K = own * omega**2
        starts.append(layout.named(layout.pack(K=K, D=_DAMPED * K / omega, **known)))
    return starts


def by_motion(phasors: Phasors, prior: InertiaPrior) -> Parameters:
    """K and D from torque over deflection by the given inertias, less sensitive to errors in them.

    The deflection is the difference of motor and arm angle: a record counts by the inverse of the arm's.
    """
    s = 1j * phasors.omega[:, None]
    torque = phasors.tau - s**2 * prior.M[prior.rotor] * phasors.q
    arm = np.linalg.solve(prior.M2[prior.pose], torque[..., None])[..., 0] / s**2
    arm = np.where(torque == 0, 1.0, arm)
    delta = phasors.q - arm
    product = torque * delta.conj() / np.abs(arm) ** 2
    K = product.real.sum(axis=0) / (np.abs(delta / arm) ** 2).sum(axis=0)
    layout = ParameterLayout.of(phasors.n, effects=["hysteresis"])
    return layout.named(
        layout.pack(
            K=np.abs(K),
            D=_ROUGH * np.abs(K / phasors.omega.max()),
            hysteresis=_ROUGH * np.abs(torque).max(axis=0),
            presliding=_ROUGH * np.abs(delta).max(axis=0),
        )
    )


def other_laws(
    phasors: Phasors, prior: InertiaPrior, start: Parameters, p: Parameters, *, is_near: bool
) -> tuple[Parameters, ...]:
    """Further start values for a law of the gears, from a fit ``p`` that ``is_near`` the data or not.

    A hysteresis loop as wide as the deflection acts like a spring, one without width like friction, and
    the width of a flat loop has no effect: such fits do not reach an optimum with small loops, which
    gets a start of its own. Changes of slope converge from one side only.
    """
    peak, found = _largest_torque(phasors, prior), []
    if "hysteresis" in p.layout:
        K = p.K + p["hysteresis"] / p["presliding"]
        wide, sharp = p["presliding"] * np.abs(K) > _WIDE * peak, p["presliding"] * p.K < _SHARP * peak
        flat = np.abs(p["hysteresis"]) < _SHARP * peak
        K = np.where(wide, K, p.K)
        if np.any(wide | sharp | flat) and np.all(K > 0):
            values = {block.name: p[block.name] for block in p.layout.blocks}
            values["K"] = K
            values["hysteresis"] = np.where(wide | flat, _NARROW * peak, p["hysteresis"])
            values["presliding"] = np.where(wide | sharp | flat, _NARROW * peak / K, p["presliding"])
            found.append(p.layout.named(p.layout.pack(**values)))
    if "piecewise" in p.layout and "cubic" in start.layout:
        knees = [Block(name, p.K.shape) for name in ("knee", "second_knee")]
        layout = ParameterLayout((*start.layout.blocks, *knees))
        largest = peak / start.K
        if is_near:  # else much of the cubic law may be another one's
            gears = map(Gear, start.K.tolist(), start["cubic"].tolist())
            largest = np.array([gear.deflection(tau) for gear, tau in zip(gears, peak, strict=True)])
        for share in _KNEES:
            wind_up = np.repeat(share, p.K.size) * np.tile(largest, 2)
            found.append(layout.named(np.concatenate([start.vector, wind_up])))
    return tuple(found)


def _largest_torque(phasors: Phasors, prior: InertiaPrior) -> Floats:
    """Torque through the gears, of all lines together in motions, shape (n,), N·m."""
    angles, torques = np.split(phasors.harmonics, 2, axis=2)
    omega = phasors.omega[:, None] * np.arange(1, angles.shape[1] + 1)
    lines = torques + omega[..., None] ** 2 * prior.M[prior.rotor, None] * angles
    lines[~phasors.motion, 1:] = 0.0
    return np.asarray(np.linalg.norm(lines, axis=1).max(axis=0))


def with_one_bend(p: Parameters) -> Parameters | None:
    """The parameters with one change of slope where two do not determine each other; None where they do.

    They coincide, or the first one is at nearly no deflection, below which no data show the slope. The
    second one starts as zero, far from the first.
    """
    if "piecewise" not in p.layout:
        return None
    knee, further, bend, last = (p[x] for x in ("knee", "second_knee", "piecewise", "second_bend"))
    same, early = further < _COINCIDE * knee, knee < _COINCIDE * further
    if not np.any(same | early):
        return None
    values = {block.name: p[block.name] for block in p.layout.blocks}
    both = bend + last
    share = np.divide(last, both, out=np.zeros_like(both), where=both != 0)
    share = np.clip(share, 0, 1)  # opposite changes: their nearly constant torque is dropped
    values["K"] = np.where(early, p.K + bend, p.K)
    values["piecewise"] = np.select([same, early], [both, last], bend)
    values["second_bend"] = np.where(same | early, 0.0, last)
    values["knee"] = knee + np.select([same, early], [share * further, further])  # the same torque
    values["second_knee"] = np.where(same | early, _APART * values["knee"], further)
    return p.layout.named(p.layout.pack(**values))


def with_delay(p: Parameters) -> Parameters:
    """The parameters, with the mean of the lags as the delay where there are lags."""
    if "lag" not in p.layout or "delay" in p.layout:
        return p
    delayed = ParameterLayout((*p.layout.blocks, Block("delay", ())))
    return delayed.named(np.append(p.vector, p["lag"].mean()))


def by_regression(law: str, phasors: Phasors, prior: InertiaPrior) -> tuple[Parameters, float] | None:
    """K, D, Coulomb friction and a law by regression of the deflection, and its squared residual.

    The latter is relative to that of linear gears. None if the regression fails.
    """
    found = law_by_regression(law, phasors, prior.M[prior.rotor], prior.M2[prior.pose])
    if found is None:
        return None
    layout = ParameterLayout.of(phasors.n, friction=True, effects=[law])
    return layout.named(layout.pack(**found.values, viscous=np.zeros(phasors.n))), found.left
