"""Random studies of every kind, good and absurd, each from a seed, and all uses of their analyses."""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np

from jointid import (
    Analysis,
    Elasticity,
    Inertia,
    JointIdError,
    SineRecord,
    Study,
    analyse,
    figures,
)
from jointid.answer import answer_sentence, further_quantities, without
from jointid.arrays import Complexes, Floats
from jointid.cut.outcome import study_outcome
from jointid.cut.path_errors import errors_of_mismatch
from jointid.cut.robot import cut_robot, reason_unusable
from jointid.exporting.identification import to_json, to_toml
from jointid.exporting.matlab import to_mat
from jointid.exporting.robot_models import mujoco_snippet, sdf_snippet, urdf_snippet
from jointid.exporting.state_space import state_space
from jointid.exporting.tables import phasor_table, transfer_matrix_table, without_friction_and_delay
from jointid.figures import response_curves
from jointid.figures.phasor_plane import phasor_plane
from jointid.figures.uncertainty import (
    left_out_prediction,
    normalised_residuals,
    worst_error,
)
from jointid.figures.waveforms import spectra, waveforms
from jointid.fleet.row import from_plain, row_of, to_plain
from jointid.joints import diagonal_zeros, locked_resonances, motor_impedance, resonances
from jointid.phasors.sine_fit import fit_sines
from jointid.reporting.html import to_html
from jointid.reporting.pdf import to_pdf
from jointid.reporting.report import make_report
from jointid.ui.study.data_quality import phasor_table as phasors_shown
from jointid.ui.study.data_quality import quality_table
from jointid.ui.study.elasticity_figures import harmonic_columns
from jointid.uncertainty.answer_tables import error_table, estimates_table
from jointid.uncertainty.information import prior_influence
from jointid.uncertainty.plan import highest_logged_hz, predict_standard_errors, suggest_records
from jointid.uncertainty.poses import fits_by_pose
from jointid.uncertainty.resampling import bootstrap, jackknife
from jointid.uncertainty.validation import (
    amplitude_dependence,
    harmonic_content,
    predict_torques,
    record_residuals,
)

METHODS = ("auto", "auto", "auto", "maximum-likelihood", "weighted", "least-squares", "explicit")


def random_study(seed: int, *, small: bool = False) -> Study:
    """Make a study of 1 to 6 joints: a robot at any scale, and on top of it up to five mishaps.

    A small one has at most 3 joints, 4 records and some 200 samples.

    Raises
    ------
    JointIdError
        When the study itself is refused.
    """
    rng = np.random.default_rng(seed)
    n = int(rng.choice([1, 1, 1, 2, 2, 3, 3] if small else [1, 1, 1, 2, 2, 2, 2, 2, 3, 3, 4, 6]))
    inertia, elasticity = _robot(rng, n)
    poses = {}
    if rng.random() < 0.2:
        poses["stretched"] = _other_pose(rng, inertia)
    frequencies, torques, rate = _campaign(rng, inertia, elasticity)
    if small:
        frequencies, torques, rate = frequencies[:4], torques[:4], min(rate, 20.0)
    mishaps = [mishap for mishap in _MISHAPS if rng.random() < 2.0 / len(_MISHAPS)]
    noise = rng.choice([0.0, 1e-6, 1e-3, 0.03]) if rng.random() < 0.8 else 1.0
    periods = float(rng.choice([1.0, 1.4, 2.6, 5.0, 10.37]))
    logs = []
    for f, torque in zip(frequencies, torques, strict=True):
        pose = "stretched" if poses and rng.random() < 0.5 else None
        logs.append(
            _log(rng, poses.get(pose or "", inertia), elasticity, f, torque, rate, periods, pose)
        )
    for log in logs:
        for name in ("theta", "tau"):
            size = np.abs(log[name]).max(axis=0)
            log[name] = log[name] + noise * size * rng.standard_normal(log[name].shape)
    for mishap in mishaps:
        mishap(rng, logs)
    if rng.random() < 0.2:  # the stated inertias are wrong
        by = 10 ** rng.uniform(-1, 1, 2)
        inertia = Inertia(inertia.M * by[0], inertia.M2 * by[1])
    nominal = Elasticity(elasticity.K * rng.uniform(0.3, 2), elasticity.D)
    hold, delay = bool(rng.random() < 0.3), float(rng.choice([0.0, 0.0, 1e-3, 5.0]))
    records = [
        SineRecord(
            frequency_hz=log["f"],
            time_s=log["time"],
            theta_rad=log["theta"],
            tau_Nm=log["tau"],
            torque_hold=hold,
            torque_delay_s=delay,
            pose=log["pose"],
        )
        for log in logs
    ]
    return Study(
        records=records,
        inertia=inertia,
        nominal=nominal if rng.random() < 0.5 else None,
        name=f"seed {seed}",
        poses=poses,
        inertia_std=float(rng.choice([0.0, 0.01, 0.05, 0.3, np.inf])),
        torque_std=float(rng.choice([0.0, 0.05, 0.3, np.inf])) if rng.random() < 0.8 else None,
    )


def _other_pose(rng: np.random.Generator, inertia: Inertia) -> Inertia:
    """The same robot in another pose, or with a known payload."""
    if rng.random() < 0.5:
        return Inertia(inertia.M, inertia.M2 * rng.uniform(0.5, 2.0))
    own = np.sqrt(np.diag(inertia.M2))
    shape = rng.standard_normal((inertia.n, inertia.n))
    return inertia.with_added(10 ** rng.uniform(-3, 1) * shape @ shape.T * np.outer(own, own))


def _robot(rng: np.random.Generator, n: int) -> tuple[Inertia, Elasticity]:
    scale = 10 ** rng.uniform(-7, 3)
    if rng.random() < 0.04:
        scale = 10 ** float(rng.choice([-300.0, -150.0, -100.0, 30.0, 60.0, 98.0]))
    spread = 10 ** rng.uniform(-1, 1, n) if rng.random() < 0.7 else 10 ** rng.uniform(-3, 3, n)
    own = scale * spread
    A = rng.standard_normal((n, n))
    coupling = A @ A.T + (10 ** rng.uniform(-3, 1)) * np.eye(n)
    coupling /= np.sqrt(np.outer(np.diag(coupling), np.diag(coupling)))
    M2 = coupling * np.sqrt(np.outer(own, own))
    resonance = 2 * np.pi * 10 ** rng.uniform(0.5, 1.7, n)
    if rng.random() < 0.1:  # another unit of time
        resonance *= 10 ** rng.uniform(-4, 4)
    K = own * resonance**2
    return Inertia(own * 10 ** rng.uniform(-1, 0.5, n), M2), Elasticity(K, K / resonance * 0.05)


def _campaign(
    rng: np.random.Generator, inertia: Inertia, elasticity: Elasticity
) -> tuple[Floats, Complexes, float]:
    """Frequencies (r,), torque phasors (r, n), and the samples per period of the highest frequency."""
    n = inertia.n
    count = int(rng.choice([1, 2, 3, 4, 6, 9]))
    own = np.sqrt(elasticity.K / np.diag(inertia.M2)) / (2 * np.pi)
    frequencies = np.median(own) * 10 ** rng.uniform(-0.7, 0.5, count)
    kind = rng.random()
    if kind < 0.1:
        frequencies[:] = frequencies[0]
    elif kind < 0.2:
        frequencies = frequencies[0] * (1 + 10 ** rng.uniform(-15, -6) * np.arange(count))
    per = int(rng.choice([1, n, n]))
    frequencies = np.repeat(frequencies, per)[: 8 if n < 4 else 6]
    size = 10 ** rng.uniform(-4, 4) if rng.random() < 0.95 else 10 ** rng.uniform(-290, 90)
    torques = size * np.exp(2j * np.pi * rng.random((frequencies.size, n)))
    torques = torques * 10 ** rng.uniform(-1, 1, (1, n))
    if rng.random() < 0.15:  # collinear: the same direction in every record
        torques[:] = torques[0]
    if rng.random() < 0.1:  # one joint at a time
        torques *= np.arange(frequencies.size)[:, None] % n == np.arange(n)
    return frequencies, torques, float(rng.choice([4.5, 8, 20, 64]))


def _log(
    rng: np.random.Generator,
    inertia: Inertia,
    elasticity: Elasticity,
    f: float,
    torque: Complexes,
    per_period: float,
    periods: float,
    pose: str | None,
) -> dict:
    with np.errstate(all="ignore"):
        s = np.array([2j * np.pi * f])
        try:
            Z, _ = motor_impedance(s, inertia.M, np.linalg.inv(inertia.M2), elasticity.K, elasticity.D)
            q = np.linalg.solve(Z[0], torque)
        except np.linalg.LinAlgError:
            q = torque.copy()
        q = np.where(np.isfinite(q), q, 1.0)
    count = max(int(np.ceil(per_period * periods)), int(rng.choice([4, 8, 12])))
    time = np.arange(count) / (f * per_period)
    wave = np.exp(2j * np.pi * f * time)[:, None]
    return {
        "f": float(f),
        "time": time,
        "theta": np.clip(np.imag(q * wave), -9e99, 9e99),
        "tau": np.clip(np.imag(torque * wave), -9e99, 9e99),
        "pose": pose,
    }


def _some(rng: np.random.Generator, logs: list[dict]) -> list[dict]:
    """All records, or one."""
    return logs if rng.random() < 0.6 else [logs[int(rng.integers(len(logs)))]]


def _signal(rng: np.random.Generator) -> str:
    return str(rng.choice(["theta", "tau"]))


def _joint(rng: np.random.Generator, logs: list[dict]) -> slice:
    """One joint, or all."""
    j = int(rng.integers(logs[0]["theta"].shape[1]))
    return slice(j, j + 1) if rng.random() < 0.8 else slice(None)


def _repeat(rng: np.random.Generator, logs: list[dict]) -> None:
    first = dict(logs[0])
    if rng.random() < 0.5:
        logs[:] = [dict(first) for _ in logs]
    else:
        logs.append(first)


def _constant(rng: np.random.Generator, logs: list[dict]) -> None:
    name, joint = _signal(rng), _joint(rng, logs)
    level = float(rng.choice([0.0, 0.0, 1.0, 1e-9, 1e6, -3.3]))
    for log in _some(rng, logs):
        log[name][:, joint] = level


def _silent(rng: np.random.Generator, logs: list[dict]) -> None:
    """A joint whose angle and torque are both zero."""
    joint = _joint(rng, logs)
    for log in _some(rng, logs):
        log["theta"][:, joint] = log["tau"][:, joint] = 0.0


def _tiny(rng: np.random.Generator, logs: list[dict]) -> None:
    by = 10 ** float(rng.choice([-9.0, -9.0, -12.0, -30.0, -100.0, -200.0, -300.0]))
    name, joint = _signal(rng), _joint(rng, logs)
    for log in _some(rng, logs):
        log[name][:, joint] *= by


def _huge(rng: np.random.Generator, logs: list[dict]) -> None:
    by = 10 ** float(rng.choice([6.0, 9.0, 30.0, 60.0, 90.0]))
    name, joint = _signal(rng), _joint(rng, logs)
    for log in _some(rng, logs):
        log[name][:, joint] = np.clip(log[name][:, joint] * by, -9e99, 9e99)


def _clipped(rng: np.random.Generator, logs: list[dict]) -> None:
    name, joint, share = _signal(rng), _joint(rng, logs), float(rng.choice([0.9, 0.5, 0.01, 1e-6]))
    for log in _some(rng, logs):
        most = share * np.abs(log[name][:, joint]).max()
        log[name][:, joint] = np.clip(log[name][:, joint], -most, most)


def _quantised(rng: np.random.Generator, logs: list[dict]) -> None:
    name, joint, counts = _signal(rng), _joint(rng, logs), float(rng.choice([0.4, 1, 2, 5, 50]))
    for log in _some(rng, logs):
        step = np.abs(log[name][:, joint]).max() / counts
        if step > 0:
            log[name][:, joint] = np.round(log[name][:, joint] / step) * step


def _rubbing(rng: np.random.Generator, logs: list[dict]) -> None:
    """Coulomb friction in the torque, as if the loop had made the motion follow."""
    share = float(rng.choice([0.01, 0.3, 3.0]))
    for log in logs:
        velocity = np.gradient(log["theta"], axis=0)
        log["tau"] = log["tau"] + share * np.abs(log["tau"]).max(axis=0) * np.sign(velocity)


def _offset(rng: np.random.Generator, logs: list[dict]) -> None:
    name, joint, by = _signal(rng), _joint(rng, logs), 10 ** rng.uniform(0, 12)
    for log in _some(rng, logs):
        log[name][:, joint] += by * max(np.abs(log[name][:, joint]).max(), 1e-12)


def _drifting(rng: np.random.Generator, logs: list[dict]) -> None:
    name, joint, by = _signal(rng), _joint(rng, logs), 10 ** rng.uniform(-1, 6)
    for log in _some(rng, logs):
        size = np.abs(log[name][:, joint]).max() / log["time"][-1]
        log[name][:, joint] += by * size * log["time"][:, None]


def _jittered(rng: np.random.Generator, logs: list[dict]) -> None:
    for log in logs:
        step = log["time"][1]
        log["time"] = log["time"] + rng.uniform(-0.3, 0.3, log["time"].size) * step


def _late_clock(rng: np.random.Generator, logs: list[dict]) -> None:
    begin = float(rng.choice([1e3, 1.7e9]))
    for log in logs:
        log["time"] = log["time"] + begin


def _short(rng: np.random.Generator, logs: list[dict]) -> None:
    for log in _some(rng, logs):
        keep = max(int(rng.choice([8, 9, 12])), int(np.ceil(1.0 / (log["f"] * log["time"][1]))))
        for name in ("time", "theta", "tau"):
            log[name] = log[name][:keep]


def _flipped(rng: np.random.Generator, logs: list[dict]) -> None:
    name, joint = _signal(rng), _joint(rng, logs)
    for log in _some(rng, logs):
        log[name][:, joint] *= -1


def _swapped(rng: np.random.Generator, logs: list[dict]) -> None:
    for log in logs:
        log["theta"], log["tau"] = log["tau"], log["theta"]


def _copied(rng: np.random.Generator, logs: list[dict]) -> None:
    """All joints show the first one's signal, or torque is a multiple of angle."""
    if rng.random() < 0.5:
        for log in logs:
            log["theta"][:] = log["theta"][:, :1]
    else:
        by = float(rng.choice([1.0, -1.0, 1e-6, 1e6]))
        for log in logs:
            log["tau"] = by * log["theta"]


def _random(rng: np.random.Generator, logs: list[dict]) -> None:
    name, joint = _signal(rng), _joint(rng, logs)
    for log in _some(rng, logs):
        log[name][:, joint] = rng.standard_normal(log[name][:, joint].shape)


def _spiked(rng: np.random.Generator, logs: list[dict]) -> None:
    """A signal that is zero but for one sample."""
    name, joint = _signal(rng), _joint(rng, logs)
    value = float(rng.choice([1e-300, 1e-9, 1.0, 9e99]))
    for log in _some(rng, logs):
        log[name][:, joint] = 0.0
        log[name][log["time"].size // 2, joint] = value


def _wrong_frequency(rng: np.random.Generator, logs: list[dict]) -> None:
    for log in _some(rng, logs):
        log["f"] *= float(rng.choice([1.01, 1.2, 2.0]))


_MISHAPS: tuple[Callable[[np.random.Generator, list[dict]], None], ...] = (
    _repeat,
    _constant,
    _constant,
    _silent,
    _tiny,
    _tiny,
    _huge,
    _clipped,
    _clipped,
    _quantised,
    _rubbing,
    _offset,
    _drifting,
    _jittered,
    _late_clock,
    _short,
    _flipped,
    _swapped,
    _copied,
    _random,
    _spiked,
    _wrong_frequency,
)


def method_of(seed: int) -> str:
    """Return the estimator that a seed's study is analysed with."""
    return METHODS[seed % len(METHODS)]


def analysed(seed: int, *, small: bool = False) -> Analysis:
    """Make and analyse the study of a seed.

    Raises
    ------
    JointIdError
        When it is refused.
    """
    return analyse(random_study(seed, small=small), method=method_of(seed))


def uses(analysis: Analysis, *, slow: bool = False) -> Iterator[tuple[str, Callable[[], object]]]:
    """All that pages, exports and the report do with an analysis, each by name; JointIdError is fine."""
    study, phasors, fit = analysis.study, analysis.phasors, analysis.fit
    given = (phasors, study.inertias, fit)
    n = fit.n
    yield "answer", lambda: (answer_sentence(analysis.quantities, analysis.nominal), without(fit))
    yield "headline", lambda: (analysis.headline, analysis.state, analysis.state_reason)
    yield "further", lambda: [quantity.shown for quantity in further_quantities(fit)]
    yield "error parts", lambda: error_table(fit)
    yield "priors", lambda: [row.cells for row in analysis.priors]
    yield "row", lambda: from_plain(to_plain(row_of(analysis, study="study")))
    yield "json", lambda: to_json(analysis)
    yield "toml", lambda: to_toml(analysis)
    yield "mat", lambda: to_mat(analysis)
    for snippet in (mujoco_snippet, urdf_snippet, sdf_snippet):
        yield snippet.__name__, partial(snippet, analysis, [100.0] * n)
    yield "tables", lambda: (phasor_table(analysis), transfer_matrix_table(analysis))
    yield "without friction", lambda: without_friction_and_delay(analysis)
    yield "state space", lambda: state_space(study.inertia, fit.elasticity)
    for what in (resonances, locked_resonances, diagonal_zeros):
        yield what.__name__, partial(lambda of: of(study.inertia, fit.elasticity), what)
    yield (
        "quality",
        lambda: (
            quality_table(study.records, phasors),
            [phasors_shown(phasors, joint) for joint in range(phasors.n)],
        ),
    )
    yield "estimates", lambda: estimates_table(analysis.fits.values(), analysis.nominal, analysis.unit)
    yield "fit", lambda: (fit.condition, fit.correlation, fit.misfit, fit.equations.matrix())
    yield from _pictures(analysis)
    yield "inertias", lambda: _inertias(analysis)
    yield "bootstrap", lambda: bootstrap(*given, draws=3).interval()
    yield "jackknife", partial(jackknife, *given)
    yield "poses", lambda: _poses(analysis)
    yield "prediction", lambda: left_out_prediction(predict_torques(fit))
    yield "residuals", lambda: _residuals(analysis)
    yield "harmonics", lambda: harmonic_columns(harmonic_content(phasors), range(phasors.n))
    yield "amplitudes", lambda: amplitude_dependence(fit)
    yield "plan", lambda: _plan(analysis)
    yield "cut robot", lambda: (reason_unusable(analysis), cut_robot(analysis))
    yield "report", lambda: to_html(make_report(analysis, cut=False))
    if slow:
        yield "outcome", lambda: study_outcome(analysis)
        yield "pdf", lambda: to_pdf(make_report(analysis))
        yield "tolerance", lambda: _tolerance(analysis)


def _pictures(analysis: Analysis) -> Iterator[tuple[str, Callable[[], object]]]:
    study, fit = analysis.study, analysis.fit
    n, record = fit.n, study.records[0]
    last = n - 1
    fitted = partial(lambda: fit_sines([record])[0].at(record.time_s, record.omega))
    yield "waveforms", lambda: waveforms(record, last, fitted(), periods=4.0)
    yield "spectra", lambda: spectra(record, last)
    yield (
        "phasor plane",
        lambda: (
            phasor_plane(analysis.phasors),
            phasor_plane(analysis.phasors, torque=True),
        ),
    )
    for pose in analysis.transfer_matrices:
        yield "element", partial(figures.element_response, analysis, last, 0, pose=pose)
        yield "model", partial(figures.model_over_measurement, analysis, last, pose=pose)
    for pose in {record.pose or "" for record in study.records}:
        yield "single record", partial(figures.single_record, analysis, last, pose=pose)
        yield "limits", partial(response_curves.magnitude_limits, analysis, pose, last)
    yield "stiffness", lambda: figures.dynamic_stiffness(fit, last, study.nominal)


def _inertias(analysis: Analysis) -> None:
    found = prior_influence(analysis.fit)
    assert found.shift.shape == (2 * analysis.fit.n, len(found.names))


def _poses(analysis: Analysis) -> None:
    study = analysis.study
    poses = [record.pose for record in study.records]
    fits = fits_by_pose(analysis.phasors, study.inertias, poses, analysis.fit)
    assert fits.significance.shape == (2 * analysis.fit.n,)


def _residuals(analysis: Analysis) -> None:
    residuals = record_residuals(analysis.phasors, analysis.fit)
    assert len(residuals.worst) == 2
    normalised_residuals(residuals)


def _plan(analysis: Analysis) -> None:
    study, phasors, fit = analysis.study, analysis.phasors, analysis.fit
    highest = highest_logged_hz(study.records, phasors)
    limit = np.maximum(np.abs(phasors.tau).max(axis=0), 1e-6)
    found = suggest_records(
        phasors, study.inertias, fit, count=1, torque_limit_Nm=limit, highest_hz=highest
    )
    worst_error(found)
    predict_standard_errors(found.records, phasors, study.inertias, fit)


def _tolerance(analysis: Analysis) -> None:
    robot = cut_robot(analysis)
    from jointid.cut.rectangle import rectangle

    errors_of_mismatch(robot.arm, rectangle(), robot.elasticity, [[0.5, 2.0], [0.5, 2.0]])


@contextmanager
def strictly() -> Iterator[Path]:
    """Every warning is an error, and what C code writes goes to a file, whose path is given."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("error")
        path = Path(folder) / "written"
        kept = [os.dup(1), os.dup(2)]
        with path.open("wb") as file:
            os.dup2(file.fileno(), 1)
            os.dup2(file.fileno(), 2)
            try:
                yield path
            finally:
                for number, descriptor in enumerate(kept, start=1):
                    os.dup2(descriptor, number)
                    os.close(descriptor)


def faults(
    seed: int, *, small: bool = False, every: int = 1, slow: bool = False
) -> list[tuple[str, Exception]]:
    """Make the study of a seed, analyse and use it; what fails with more than a refusal, by name.

    Of the uses, every so many are tried, another choice with another seed.
    """
    found: list[tuple[str, Exception]] = []

    def attempt(name: str, call: Callable[[], object]) -> object:
        try:
            return call()
        except JointIdError:
            return None
        except Exception as error:  # what it is, is the question
            found.append((name, error))
            return None

    with strictly() as written:
        analysis = attempt("analyse", partial(analysed, seed, small=small))
        if isinstance(analysis, Analysis):
            for name, call in list(uses(analysis, slow=slow))[seed % every :: every]:
                attempt(name, call)
        if text := written.read_text(errors="replace"):
            found.append(("output", AssertionError(text[:300])))
    return found
