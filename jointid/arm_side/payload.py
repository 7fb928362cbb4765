"""Payload from the motor torques, a prior for the deflection equations; zero positions of joints."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from jointid.arm_side.band_limited import BandLimited, GaussianFilter
from jointid.arm_side.mixed_model import Estimate, Regression, low_frequency_noise
from jointid.arm_side.terms import waves
from jointid.arrays import Floats
from jointid.records import MotionRecord
from jointid.robot_models.model import RobotModel
from jointid.wording import joints_text

_SCALE_STD = 0.15
"""Spread of the torque constant; the gear's efficiency counts as load-dependent friction."""
_ROTOR_STD = 0.1
"""Relative standard deviation of the rotors' inertia."""
_SLIP = 0.1
"""Lowest velocity, in parts of a joint's largest, at which its friction has a sign."""
_SLOWER = 0.5
"""Band of this fit, in bands of the record: the torque of acceleration also holds that of the encoders'
vibration and ripple, which grows with the square of the frequency. It is the same in all columns; the
fit cancels it by a heavier payload on lighter links: 5 to 25 kg with 3 seconds of arc near 10 Hz."""
_MEMORY_S = 0.5
_FEWEST = 40
_MOST_SCALES, _MOST_LEFT = 3.0, 0.2
"""Deviation of the torque's scale, in its standard deviations, and unexplained part of a torque, from
which motors contradict the model. Real motors leave 0.02, in 3 s of little motion up to 0.06; exchanged
or reversed joints, torques of other motors and a wrong unit of time, 0.2 to 1."""
_FRICTION_COUNTS = 0.5
"""Weight of friction in addition to the variation of a torque, the reference of the unexplained part: in
a move in one direction, friction hardly varies, but the error of its law is relative to the whole."""
_CHANCE, _FREEDOM = 1e-3, 10.0
"""Probability that noise alone leaves more than the limit of the unexplained part, and number of fitted
coefficients: a few seconds have few independent samples in the band of this fit."""
_ZERO_STD = 0.5
"""Prior standard deviation of the zero of a joint angle, rad."""
_MISPLACED_RAD, _SURELY_MISPLACED = 0.03, 5.0
"""Error of a zero that shifts K noticeably, and in its standard deviations, from which it is reported:
up to 0.01 rad and 2.5 with links whose masses, inertias and centres are 5 % wrong; 1.0 in a real log."""
_ROUNDS, _STEP_RAD = 3, 1e-4
_FROM_MODEL = (
    "K of every joint follows from the torque of the robot model and is wrong until this is corrected."
)


@dataclass(frozen=True, eq=False)
class Signs:
    """Wrong signs of the joints, masks (n,)."""

    torque: NDArray[np.bool_]
    """The sign of the logged torque."""
    axis: NDArray[np.bool_]
    """The direction of the joint in the robot model, or of its logged angle."""

    @classmethod
    def right(cls, n: int) -> Self:
        """Return those of n joints without a wrong sign."""
        return cls(np.zeros(n, bool), np.zeros(n, bool))

    @property
    def refusal(self) -> str:
        """Reason why K of every joint is refused: a joint turns the other way; empty otherwise."""
        where = self.axis & self.torque, self.axis & ~self.torque
        of_log, of_model = (np.flatnonzero(joints) + 1 for joints in where)
        causes = []
        if of_log.size:
            causes.append(
                f"The motor torques show a wrong sign of the logged angle of {joints_text(of_log)}: "
                "check the column and its sign."
            )
        if of_model.size:
            causes.append(
                f"The motor torques fit a robot model in which {joints_text(of_model)} "
                f"turn{'s' * (of_model.size == 1)} the other way: check the sign of the gear ratio, the "
                "direction of the axis in the robot model, and the signs of the logged angle and torque."
            )
        return " ".join([*causes, _FROM_MODEL] if causes else [])


@dataclass(frozen=True, eq=False)
class MotorTorques:
    """Estimates of payload and errors of the robot model from the motor torques."""

    mean: Floats
    """Estimate of the payload's standardised parameters, shape (4,)."""
    root: Floats
    """Square root of their covariance, shape (4, 4)."""
    scale: Floats
    """Torque of each motor, without its rotor, over that of the robot model, shape (n,); NaN where the
    joint hardly moves."""
    left: Floats
    """Part of it that neither model, friction, noise nor chance explain (rms), shape (n,); NaN
    likewise."""
    zero: Floats
    """Angle to add to each logged joint angle, by these torques, (n,), rad; 0 where not estimated."""
    zero_std: Floats
    """Its standard deviation, shape (n,), rad; infinite where not estimated."""
    reversed: Signs
    """Joints whose torque or direction has the wrong sign."""

    @property
    def misplaced(self) -> Floats:
        """Angles to add to the logged ones, then their standard deviations, (2, n); NaN without need."""
        off = np.abs(self.zero) > np.maximum(_MISPLACED_RAD, _SURELY_MISPLACED * self.zero_std)
        return np.where(off, [self.zero, self.zero_std], np.nan)

    @property
    def contradicted(self) -> NDArray[np.bool_]:
        """Joints whose motors contradict the robot model, mask (n,)."""
        off = np.abs(np.nan_to_num(self.scale, nan=1.0) - 1) > _MOST_SCALES * _SCALE_STD
        return np.asarray(off | (np.nan_to_num(self.left) > _MOST_LEFT))


def payload_from_motors(
    records: list[MotionRecord],
    motions: list[BandLimited],
    robot: RobotModel,
    torque_std: float,
    torque: list[Floats],
    payload: list[Floats],
    parts: list[Floats],
    near: Floats,
    zeros: bool = False,
) -> MotorTorques:
    """Estimate the payload's standardised parameters and, with ``zeros``, the zeros of the joint angles.

    Each joint's motor torque, without its rotor, is the torque of links and payload times a scale
    near 1, plus Coulomb, viscous and load-dependent friction. The rotor's torque, every link, the
    counterbalance and the links' gravity, a wave over the joint angle, are uncertain as well: none may
    pass for a payload. ``torque_std`` is the relative standard deviation of the links' torque of
    gravity. Of every record, ``torque``, shape (N, n), N·m, is that of the model with the payload as
    given; ``payload``, shape (N, n, 4), and ``parts``, shape (N, n, n + 1), its change per standard
    deviation of the payload, of every link and of the counterbalance. ``near``, shape (4,), is the
    estimate so far: the torque constant scales the payload's torque as well. The payload is estimated
    with the zeros as given: fitted zeros would widen its error where they are correct.
    """
    torque = [model + change @ near for model, change in zip(torque, payload, strict=True)]
    torques = Torques.of(records, motions, robot, torque_std, torque, parts)
    shared, scale, left = _estimated(torques, Shared(payload, near, np.ones(4)))
    root = np.linalg.cholesky((shared.covariance + shared.covariance.T) / 2)
    unknown = np.zeros(robot.n), np.full(robot.n, np.inf)
    right = Signs.right(robot.n)
    found = MotorTorques(shared.mean, np.asarray(root, float), scale, left, *unknown, right)
    if not zeros:
        return found
    start, std = np.append(near, np.zeros(robot.n)), np.repeat([1.0, _ZERO_STD], [4, robot.n])
    load = float(near[0])
    for _ in range(2):  # a wrong zero passes for another payload, whose torque it also turns
        mass = max(0.0, robot.payload.mass + robot.payload.mass_std * load)
        turned = [_by_zeros(robot.with_payload(mass=mass), m) for m in motions]
        both = [np.concatenate(each, axis=2) for each in zip(payload, turned, strict=True)]
        shared, _, _ = _estimated(torques, Shared(both, start, std))
        load = float(shared.mean[0])
    return replace(found, zero=shared.mean[4:], zero_std=np.sqrt(np.diag(shared.covariance)[4:]))


def _by_zeros(robot: RobotModel, motion: BandLimited) -> Floats:
    """Change of the torques with the zero of each joint angle, shape (N, n, n), N·m/rad."""
    both = [
        [robot.torque(motion.q + side * one, motion.dq, motion.ddq) for side in (_STEP_RAD, -_STEP_RAD)]
        for one in np.eye(robot.n)
    ]
    return np.stack([(ahead - back) / (2 * _STEP_RAD) for ahead, back in both], axis=2)


@dataclass(frozen=True, eq=False)
class Shared:
    """Unknowns that all joints share: torques per unit of each, and what is known before the fit."""

    columns: list[Floats]
    """Of every record, shape (N, n, S), N·m."""
    near: Floats
    """Values with which the torques of the model were computed, shape (S,)."""
    std: Floats
    """Prior standard deviations about 0, shape (S,)."""


@dataclass(frozen=True, eq=False)
class _Found:
    """Estimate of the shared unknowns: mean (S,) and covariance (S, S)."""

    mean: Floats
    covariance: Floats


@dataclass(frozen=True, eq=False)
class Torques:
    """Torques at the joints in the band, of every record (N, n), N·m."""

    motions: list[BandLimited]
    motor: list[Floats]
    """Of the motors, without their rotors."""
    rotor: list[Floats]
    model: list[Floats]
    """Of the robot model."""
    parts: list[Floats]
    """Change of the model's per standard deviation of links and counterbalance, (N, n, n + 1)."""
    gravity_std: Floats
    """Standard deviation of the links' gravity, shape (n,)."""
    noise: Floats
    """Standard deviation of the motors' white noise, shape (n,)."""

    @classmethod
    def of(
        cls,
        records: list[MotionRecord],
        motions: list[BandLimited],
        robot: RobotModel,
        torque_std: float,
        model: list[Floats],
        parts: list[Floats],
    ) -> "Torques":
        """Reflect the logged torques through the gears, in the band of the motions."""
        back, every = np.linalg.inv(robot.coupling), np.concatenate([m.q for m in motions])
        inertia = np.nan_to_num(robot.rotor_inertia)  # 0 where it is unknown
        rotor = [np.asarray(inertia * (m.ddq @ back.T) @ back) for m in motions]
        motor = [
            m.lowpass(np.asarray(record.tau_Nm[record.start :])) @ back - own
            for record, m, own in zip(records, motions, rotor, strict=True)
        ]
        gravity = np.abs(robot.torque(every, 0 * every, 0 * every)).max(axis=0)
        fourth = [np.diff(record.tau_Nm[record.start :] @ back, 4, axis=0) for record in records]
        noise = np.median(np.abs(np.concatenate(fourth)), axis=0) / 0.6745 / np.sqrt(70)  # no motion
        return cls(motions, motor, rotor, model, parts, torque_std * gravity, noise)

    def of_joint(self, j: int, shared: Shared) -> tuple[Regression, Floats, list[int]]:
        """Equation of joint j where it moves, prior standard deviations, first row of later records.

        The columns are those of ``shared``, the parts, gravity as a wave, the torques of model and
        rotor, then five of friction and offset.
        """
        y, columns = [], []
        of_record = zip(
            self.motions, self.motor, self.rotor, self.model, shared.columns, self.parts, strict=True
        )
        for m, motor, rotor, model, change, own in of_record:
            dt, band = m.lowpass.interval_s, m.lowpass.band_hz
            slower = GaussianFilter(dt, band * (_SLOWER**-2 - 1) ** -0.5)
            reach = m.lowpass.reach + slower.reach
            rows = np.arange(len(m.q))[reach : len(m.q) - reach : _step(m.lowpass)]
            rows = rows[np.abs(m.dq[rows, j]) > _SLIP * np.abs(m.dq[:, j]).max()]
            sign = m.lowpass(np.sign(m.dq[:, j]))  # reversals as wide as in the torque
            v, s = m.dq[:, j], model[:, j]
            X = [change[:, j].T, own[:, j].T, self.gravity_std[j] * waves(m.q[:, j], np.ones(1)).T]
            X += [s, rotor[:, j], sign, sign * np.abs(s), v, v * np.abs(v), np.ones(v.size)]
            y.append(slower(motor[:, j] - s)[rows])
            columns.append(slower(np.vstack(X).T)[rows])
        data = Regression(np.concatenate(y), np.concatenate(columns))
        model_std = np.ones(self.parts[0].shape[2] + 2)
        std = np.concatenate([shared.std, model_std, [_SCALE_STD, _ROTOR_STD], np.full(5, np.inf)])
        std[np.linalg.norm(data.columns, axis=0) < 1e-9] = 0.0
        return data, std, np.cumsum([part.size for part in y])[:-1].tolist()

    def fitted(self, j: int, shared: Shared) -> tuple[Regression, Floats, Estimate] | None:
        """Equation of joint j, its prior standard deviations, and its fit; None if it hardly moves.

        The noise of the fit is that of its residual.
        """
        data, std, later = self.of_joint(j, shared)
        if data.y.size < _FEWEST:
            return None
        noise = float(data.y.std())
        lags = int(_MEMORY_S * 8 * self.motions[0].lowpass.band_hz)
        for _ in range(_ROUNDS):
            estimate = data.estimate(noise, std)
            noise = low_frequency_noise(data.residual(estimate), later, lags, _FREEDOM)
        return data, std, data.estimate(noise, std)

    def independent(self, data: Regression) -> tuple[float, float, float]:
        """Count independent values of an equation; also their resolution and the sampling, both s."""
        first = self.motions[0].lowpass
        slow, interval_s = GaussianFilter(first.interval_s, _SLOWER * first.band_hz), first.interval_s
        resolution_s = 2 * np.sqrt(np.pi) * slow.width_s
        count = np.sqrt(2) * data.y.size * _step(first) * interval_s / resolution_s
        return float(count), float(resolution_s), interval_s

    def unexplained(self, j: int, data: Regression, fitted: Estimate) -> float:
        """Part of the torque of joint j that only a wrong model leaves: lower confidence limit, rms."""
        independent, resolution_s, interval = self.independent(data)
        freedom = max(independent - _FREEDOM, 0.25 * independent)
        left = data.residual(fitted).var() * independent / chdtri(freedom, _CHANCE)
        left -= self.noise[j] ** 2 * interval / resolution_s
        friction = data.columns[:, -5:-1] @ fitted.beta[-5:-1]
        whole = (data.y + data.columns[:, -7]).var() + _FRICTION_COUNTS**2 * np.mean(friction**2)
        return float(np.sqrt(max(0.0, left) / max(1e-18, whole)))


def _step(lowpass: GaussianFilter) -> int:
    """Samples from one equation to the next: eight equations in a period of the band's end."""
    return max(1, int(1 / (8 * lowpass.band_hz * lowpass.interval_s)))


def _estimated(torques: Torques, shared: Shared) -> tuple[_Found, Floats, Floats]:
    """Estimate the shared unknowns, and the scale and unexplained part of each motor's torque."""
    joints, count = torques.gravity_std.size, shared.std.size
    prior = np.diag(shared.std**-2.0)
    opinions: list[tuple[Floats, Floats]] = []
    scale, left = np.full((2, joints), np.nan)
    for j in range(joints):
        found = torques.fitted(j, shared)
        if found is None:
            continue
        data, std, fitted = found
        scale[j], left[j] = 1 + fitted.beta[-7], torques.unexplained(j, data, fitted)
        seen = std[:count] > 0
        information, of_seen = np.zeros((count, count)), np.ix_(seen, seen)
        information[of_seen] = np.linalg.inv(fitted.covariance[:count, :count][of_seen])
        alone = information - prior * seen
        opinions.append((alone, information @ fitted.beta[:count] + alone @ shared.near))
    return _combined(opinions, prior), scale, left


def _combined(opinions: list[tuple[Floats, Floats]], prior: Floats) -> _Found:
    """Combine the joints' estimates: information (S, S) and its product with the estimate, (S,)."""
    zero = np.zeros(len(prior))
    information = prior + sum((A for A, _ in opinions), 0 * prior)
    mean = np.asarray(np.linalg.solve(information, sum((b for _, b in opinions), zero)), float)
    # joints that contradict each other are all less certain than their noise (Birge's ratio)
    excess = sum(_distance(A, b, mean) for A, b in opinions) / max(1, 3 * len(opinions) - 4)
    wider = max(1.0, excess)
    covariance = np.linalg.inv(prior + (information - prior) / wider)
    right = sum((b for _, b in opinions), zero) / wider
    return _Found(np.asarray(covariance @ right), np.asarray(covariance))


def _distance(information: Floats, right: Floats, mean: Floats) -> float:
    """Squared distance of a mean from one joint's own, in its standard deviations."""
    own = np.linalg.pinv(information, rcond=1e-6, hermitian=True) @ right
    return float((own - mean) @ information @ (own - mean))
