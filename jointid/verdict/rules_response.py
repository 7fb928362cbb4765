"""Rules of the verdict on frequency responses: origin of peaks, frequencies without H, and passivity."""

from collections.abc import Iterator

import numpy as np

from jointid.arrays import Floats
from jointid.joints import resonances
from jointid.phasors.passivity import taken_power
from jointid.transfer_matrix import TransferMatrix, single_record_response
from jointid.verdict.evidence import Evidence, Finding, note, number, some
from jointid.verdict.rules_outlier import foreign
from jointid.verdict.rules_records import off_frequency
from jointid.wording import counted

_STANDS_OUT = np.log(1.4)
"""Logarithmic prominence of a peak: 40 % above the minima on both sides."""

_SURE = 5.0
"""Standard errors from which an absorbed power is significant."""

_FEWEST = 8
"""Frequencies; with fewer, a peak is a single point."""


def rejected(evidence: Evidence) -> Iterator[Finding]:
    """Frequencies without a solution of equation (17)."""
    if off_frequency(evidence):  # a single record at its frequency is a consequence
        return
    texts = [text for matrix in evidence.transfer_matrices.values() for text in matrix.rejected]
    if texts:
        verb = "has" if len(texts) == 1 else "have"
        yield note(
            f"{counted(len(texts), 'frequency')} {verb} no transfer matrix",
            texts[0],
            "No action needed for K and D. The comparison of model and data omits these frequencies.",
            1e-3,
        )


def foreign_peak(evidence: Evidence) -> Iterator[Finding]:
    """As in the paper's Figures 3 and 4: a peak in the response of one record that H does not have."""
    fit = evidence.fit
    if fit.n == 1 or np.any(fit.K <= 0) or fit.misfit > 100:
        return
    found: dict[int, Finding] = {}
    for pose, matrix in evidence.transfer_matrices.items():
        if matrix.omega.size < _FEWEST:
            continue
        index, inertia = evidence.of_pose(pose)
        own = resonances(inertia, fit.elasticity) if np.all(fit.D >= 0) else np.zeros(0)
        for records in _series(evidence, index, matrix):
            response = np.abs(single_record_response(evidence.phasors.select(records)))
            for j in sorted(set(range(fit.n)) - set(found)):
                finding = _controller_peak(evidence, matrix, response[:, j], records, own, j)
                if finding is not None:
                    found[j] = finding
    yield from found.values()


def _series(evidence: Evidence, index: np.ndarray, matrix: TransferMatrix) -> list[np.ndarray]:
    """The first record of every frequency of H, the second of every one, and so on."""
    groups = {omega: index[group] for omega, group in evidence.phasors.select(index).by_frequency()}
    chosen = [groups[omega] for omega in matrix.omega]
    return [np.array([g[k] for g in chosen]) for k in range(min(map(len, chosen)))]


def _controller_peak(
    evidence: Evidence,
    matrix: TransferMatrix,
    alone: Floats,
    records: np.ndarray,
    own_hz: Floats,
    j: int,
) -> Finding | None:
    H = np.abs(matrix.H[:, j, j])
    if not np.isfinite(alone).all() or np.any(5 * matrix.standard_deviation[:, j, j] > H):
        return None
    frequency = matrix.omega / (2 * np.pi)
    true = _peaks(H)
    of_model = [int(np.argmin(np.abs(np.log(frequency / f)))) for f in own_hz]
    foreign = [p for p in _peaks(alone) if all(abs(p - t) > 1 for t in [*true, *of_model])]
    elastic = [t for t in true if any(abs(t - m) <= 1 for m in of_model)]  # others come from friction
    if not foreign or not elastic:
        return None
    worst = max(foreign, key=lambda p: alone[p] / H[p])
    others = [i + 1 for i in range(evidence.fit.n) if i != j]
    whose = f"joint {others[0]}" if len(others) == 1 else "the other joints"
    peaks = "resonance is the peak" if len(elastic) == 1 else "resonances are the peaks"
    return note(
        f"The peak of joint {j + 1} at {number(frequency[worst])} Hz comes from the controller "
        f"of {whose}",
        f'In the single record "{evidence.phasors.labels[records[worst]]}", acceleration over torque '
        f"is {number(alone[worst] / H[worst], 2)} times H{j + 1}{j + 1}, which has no peak at this "
        f"frequency. The elastic {peaks} of H{j + 1}{j + 1} at "
        f"{some([f'{number(frequency[t])} Hz' for t in elastic])}.",
        "No action needed: K and D are fitted jointly. Do not read them off the response of a single "
        "record.",
        0.3,
    )


def _peaks(response: Floats) -> list[int]:
    """Peaks above the higher of the two valleys beside them, as far as the next higher point.

    As ``scipy.signal.find_peaks``, whose import takes a third of a second.
    """
    x = np.log(np.maximum(response, 1e-300))
    found = []
    for p in 1 + np.flatnonzero((x[1:-1] > x[:-2]) & (x[1:-1] > x[2:])):
        higher = np.flatnonzero(x > x[p])
        left = higher[higher < p].max(initial=-1) + 1
        right = higher[higher > p].min(initial=x.size)
        if x[p] - max(x[left:p].min(), x[p + 1 : right].min()) >= _STANDS_OUT:
            found.append(int(p))
    return found


def motors_take_power(evidence: Evidence) -> Iterator[Finding]:
    """Records in which the motors would absorb power from the robot."""
    phasors = evidence.phasors
    taken = taken_power(phasors.omega, phasors.z, phasors.covariance) > _SURE
    if taken.any():
        yield foreign(
            evidence,
            taken,
            "the motors would absorb power, which elastic joints, inertias and friction cannot supply",
        )
