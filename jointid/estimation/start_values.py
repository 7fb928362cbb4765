"""Start values for a fit that does not converge from those of the linear estimator.

Friction biases that one: if it is half of the torque, K may be ten times too small. ``friction_start``
compares the torque of the model, Z(K, D) q, with the measured one at the fundamental, in relative terms
and with a loss that is robust to outliers; friction is linear in it and is eliminated (variable
projection; Golub and Pereyra, SIAM Journal on Numerical Analysis 10, 1973).
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares as nonlinear_least_squares

from jointid.arrays import Complexes, Floats
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.joint_equations import inertia_arrays
from jointid.estimation.estimators.parameters import Block, ParameterLayout, Parameters
from jointid.gears.gear import Gear
from jointid.gears.law_regression import law_by_regression
from jointid.joints import motor_impedance
from jointid.motion.friction import friction_waveforms
from jointid.phasors.extract import Phasors

_LEAST_SHARE = 1e-3
"""Least eigenvalue of M2 with unit diagonal."""
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
_UNEXPLAINED = 0.1
"""Relative residual of the linear estimate from which friction is tried."""
_OUTLIER = 0.1
"""Relative residual from which a record counts less."""
_BETTER = 0.5
"""Residual over that of the linear estimate below which the new start is taken."""
_STARTS = 0.75, 0.5, 1.0
"""Quantiles of the frequencies at which the arm resonates with the motors held."""
_EVALUATIONS = 30
"""Most Jacobians from each of them."""
_RANGE = 30.0
"""Largest factor on a start value: the arm resonates within a factor of 5 of the frequencies."""
_UNUSUAL = 3.0
"""Standard deviations within which a common unknown lies."""
_HUGE = 1e50
"""Largest relative residual; its square and sums of squares stay finite."""


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
    torque = phasors.tau + phasors.omega[:, None] ** 2 * prior.M[prior.rotor] * phasors.q
    peak, found = np.abs(torque).max(axis=0), []
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


def without_inertias(phasors: Phasors, prior: InertiaPrior) -> Parameters | None:
    """K, D, M and M2 by linear least squares, without the given inertias; None if not physical.

    With c = M2⁻¹ and κ = K + sD, equation (8) of joint j is

        κ_j q_j + Σ_k κ_j c_jk M_k q_k − Σ_k κ_j c_jk τ_k/s² + M_j s² q_j = τ_j,

    linear in M_j and in the products with K_j and D_j. Poses differ in M2, hence only for one.
    """
    n = phasors.n
    if phasors.motion.any():  # where (8) has end terms
        return None
    several = len(prior.M) > 1 or len(prior.M2) > 1
    if several or prior.added.any() or prior.gravity.any() or 2 * phasors.omega.size < 4 * n + 1:
        return None
    s, q = 1j * phasors.omega[:, None], phasors.q
    rigid = np.concatenate([q, -phasors.tau / s**2], axis=1)
    M, K, D, arm = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros((n, n))
    for j in range(n):
        columns = np.concatenate([rigid, s * rigid, s**2 * q[:, [j]]], axis=1)
        x = _least_squares(columns, phasors.tau[:, j])
        if x is None:
            return None
        of_K, of_D, M[j] = x[: 2 * n], x[2 * n : 4 * n], x[4 * n]
        K[j], D[j] = of_K[j] - of_K[n + j] * M[j], of_D[j] - of_D[n + j] * M[j]
        arm[j] = of_K[n:] / K[j]
    if not (np.all(K > 0) and np.all(M > 0) and np.all(np.diag(arm) > 0)):
        return None
    arm = (arm + arm.T) / 2
    own = np.sqrt(np.diag(arm))
    if np.linalg.eigvalsh(arm / np.outer(own, own))[0] < _LEAST_SHARE:
        return None
    M2 = np.linalg.inv(arm)
    D = np.clip(D, 0.1 * _DAMPED * K / phasors.omega.max(), K / phasors.omega.min())
    layout = ParameterLayout.of(n, rotors=1, arms=1)
    return layout.named(layout.pack(K=K, D=D, M=M, M2=M2[prior.elements]))


def _least_squares(A: Complexes, b: Complexes) -> Floats | None:
    """Real solution of complex equations, each row of unit length; None where it is undetermined."""
    size = np.linalg.norm(A, axis=0)
    if not np.all(size > 0):
        return None
    rows = np.linalg.norm(np.column_stack([A / size, b / np.linalg.norm(b)]), axis=1)
    if not np.all(rows > 0):
        return None
    A, b = A / size / rows[:, None], b / rows
    x, _, rank, _ = np.linalg.lstsq(
        np.concatenate([A.real, A.imag]), np.concatenate([b.real, b.imag]), rcond=1e-10
    )
    return np.asarray(x / size) if rank == size.size else None


@dataclass(frozen=True, eq=False)
class _Fundamentals:
    """Torques at the fundamental, and the friction phasors of each joint."""

    phasors: Phasors
    M: Floats
    own: Floats
    """Mean M2 of each joint alone, shape (n,)."""
    arm: Floats
    """Dynamic M2, with gravity, shape (r, n, n)."""
    shared: Floats
    """Its change with a common unknown such as the payload, per standard deviation, (r, n, n)."""
    friction: Complexes
    """Phasors of Coulomb and viscous friction, shape (r, n, 2)."""
    moving: np.ndarray
    """Whether a joint moves in a record, shape (r, n)."""

    def residual(self, p: Floats) -> tuple[Floats, Floats]:
        """Relative residual, shape (rows,), and the friction, (2, n).

        ``p`` has the logarithms of K and D and, if any, the gravity stiffness over M2 ω² at the lowest
        frequency and the common unknown.
        """
        n, ph = self.phasors.n, self.phasors
        s, common = np.asarray(1j * ph.omega, np.complex128), p[p.size - self.shared.any() :]
        held = np.eye(n) * self.gravity(p) / ph.omega[:, None, None] ** 2
        arm = np.linalg.inv(self.arm + self.shared * common.sum() - held)
        Z, _ = motor_impedance(s, self.M, arm, *np.exp(p[: 2 * n].reshape(2, n)))
        rest = ph.tau - (Z @ ph.q[..., None])[..., 0]
        residual, found = [], np.zeros((2, n))
        for j in range(n):
            used = self.moving[:, j] & (np.abs(ph.tau[:, j]) > 0)
            weight = 1 / np.abs(ph.tau[used, j])
            A, b = (_real(x * w) for x, w in (
                (self.friction[used, j], weight[:, None]), (rest[used, j], weight)
            ))  # fmt: skip
            if np.isfinite(A).all() and np.isfinite(b).all():
                found[:, j] = np.maximum(np.linalg.lstsq(A, b, rcond=None)[0], 0.0)
                b -= A @ found[:, j]
            residual.append(b)
        return np.concatenate([*residual, _OUTLIER * common]), found

    def gravity(self, p: Floats) -> Floats:
        """Gravity stiffness of each joint, shape (n,), N·m/rad; zero where ``p`` has none."""
        given = p[2 * self.own.size : p.size - self.shared.any()]
        unit = self.own * self.phasors.omega.min() ** 2
        return np.asarray(given * unit if given.size else 0 * unit)

    def relative(self, p: Floats) -> Floats:
        """The residual alone, finite at any K and D."""
        with np.errstate(all="ignore"):
            return np.clip(np.nan_to_num(self.residual(p)[0], nan=_HUGE), -_HUGE, _HUGE)


def friction_start(
    phasors: Phasors, prior: InertiaPrior, linear: Parameters, *, hangs: bool = False
) -> Parameters | None:
    """Return K, D and the friction of all joints; None where the least-squares estimate is as good.

    With a common unknown as the payload also M2; with ``hangs`` unknown gravity stiffness, too.
    """
    n, waveforms = phasors.n, friction_waveforms(phasors, None)
    M, arm = inertia_arrays(phasors, prior.inertias(prior.M, prior.M2))
    of_gravity = prior.shared_gravity[prior.pose] / phasors.omega[:, None, None] ** 2
    shared = prior.shared[prior.part[prior.pose]] - of_gravity
    own = np.diagonal(prior.M2[prior.pose], axis1=1, axis2=2).mean(axis=0)
    data = _Fundamentals(
        phasors,
        M,
        own,
        np.asarray(np.linalg.inv(arm), np.float64),
        shared,
        np.stack([waveforms.coulomb[:, 0], 1j * phasors.omega[:, None] * phasors.q], axis=2),
        ~waveforms.stationary,
    )
    rest, least = np.zeros(n * hangs + int(shared.any())), np.inf
    if np.all(linear.K > 0) and np.all(linear.D > 0):
        least = _size(data.residual(np.concatenate([np.log([*linear.K, *linear.D]), rest]))[0])
    if least < _UNEXPLAINED:
        return None
    best, start = _BETTER * least, None
    for share in _STARTS:
        omega = float(np.quantile(phasors.omega, share))
        first = np.concatenate([np.log([*(own * omega**2), *(0.05 * own * omega)]), rest])
        reach = np.where(np.arange(first.size) < 2 * n, np.log(_RANGE), _UNUSUAL)
        found = nonlinear_least_squares(
            data.relative,
            first,
            bounds=(first - reach, first + reach),
            loss="soft_l1",
            f_scale=_OUTLIER,
            ftol=1e-3,
            max_nfev=_EVALUATIONS,
        )
        residual, friction = data.residual(found.x)
        if _size(residual) < best:
            best, (K, D) = _size(residual), np.exp(found.x[: 2 * n].reshape(2, n))
            values = {"K": K, "D": D, "coulomb": friction[0], "viscous": friction[1]}
            values |= {"gravity": data.gravity(found.x)} if hangs else {}
            values |= {"M2": prior.lower + found.x[-1] * prior.common} if shared.any() else {}
            arms, effects = len(prior.lower) * bool(shared.any()), ["gravity"] * hangs
            layout = ParameterLayout.of(n, friction=True, arms=arms, effects=effects)
            start = layout.named(layout.pack(**values))
        if best < _UNEXPLAINED:
            break
    return start


def _size(residual: Floats) -> float:
    """Typical size without outliers; infinite on overflow."""
    size = np.nan_to_num(np.abs(residual), nan=np.inf, posinf=np.inf)
    return float(np.median(size)) if size.size else np.inf


def _real(values: Complexes) -> Floats:
    return np.concatenate([values.real, values.imag])
