"""Rules of the verdict that look at responses: which peak is whose, and where H is missing."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from jointid.arrays import Floats
from jointid.joints import resonances
from jointid.transfer_matrix import TransferMatrix, single_record_response
from jointid.verdict.evidence import Evidence, Finding, note, number, some
from jointid.verdict.rules_records import off_frequency, same_experiment
from jointid.wording import counted

_STANDS_OUT = np.log(1.4)
"""A peak is 40 % above the valleys on both of its sides."""

_FEWEST = 8  # frequencies; with fewer, a peak is one point


def rejected(evidence: Evidence) -> Iterator[Finding]:
    """Frequencies at which equation (17) could not be solved."""
    if off_frequency(evidence):  # a record at a frequency of its own is what follows from that
        return
    texts = [text for matrix in evidence.transfer_matrices.values() for text in matrix.rejected]
    if any(same_experiment(evidence)):  # that has been told
        texts = [text for text in texts if "the same experiment" not in text]
    if texts:
        verb = "has" if len(texts) == 1 else "have"
        yield note(
            f"{counted(len(texts), 'frequency')} {verb} no transfer matrix",
            texts[0],
            "K and D do not need it; the comparison of model and measurement does.",
            1e-3,
        )


def foreign_peak(evidence: Evidence) -> Iterator[Finding]:
    """The story of Figures 3 and 4: a peak of one record's response that H does not have."""
    fit = evidence.fit
    if fit.n == 1 or np.any(fit.K <= 0) or fit.misfit > 100:
        return
    told: dict[int, Finding] = {}
    for pose, matrix in evidence.transfer_matrices.items():
        if matrix.omega.size < _FEWEST:
            continue
        index, inertia = evidence.of_pose(pose)
        own = resonances(inertia, fit.elasticity) if np.all(fit.D >= 0) else np.zeros(0)
        for records in _families(evidence, index, matrix):
            response = np.abs(single_record_response(evidence.phasors.select(records)))
            for j in range(fit.n):
                finding = (
                    None if j in told else _story(evidence, matrix, response[:, j], records, own, j)
                )
                if finding is not None:
                    told[j] = finding
    yield from told.values()


def _families(evidence: Evidence, index: np.ndarray, matrix: TransferMatrix) -> list[np.ndarray]:
    """The first record of every frequency of H, the second of every one, and so on."""
    groups = {omega: index[group] for omega, group in evidence.phasors.select(index).by_frequency()}
    chosen = [groups[omega] for omega in matrix.omega]
    return [np.array([g[k] for g in chosen]) for k in range(min(map(len, chosen)))]


def _story(
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
    if not foreign or not true:
        return None
    worst = max(foreign, key=lambda p: alone[p] / H[p])
    others = [i + 1 for i in range(evidence.fit.n) if i != j]
    whose = f"joint {others[0]}" if len(others) == 1 else "the other joints"
    elastic = some([number(frequency[t]) for t in true])
    return note(
        f"The peak of joint {j + 1} at {number(frequency[worst])} Hz belongs to the controller "
        f"of {whose}",
        f"Acceleration over torque of {evidence.phasors.labels[records[worst]]} alone peaks there "
        f"{number(alone[worst] / H[worst], 2)} times above H{j + 1}{j + 1}, which has no peak. "
        f"The elasticity is the peak at {elastic} Hz, which both show.",
        "Nothing: K and D come from both joints together. Do not read them off a single record's "
        "response.",
        0.3,
    )


def _peaks(response: Floats) -> list[int]:
    from scipy.signal import find_peaks  # slow to import, and few analyses come here

    return [int(p) for p in find_peaks(np.log(np.maximum(response, 1e-300)), prominence=_STANDS_OUT)[0]]
