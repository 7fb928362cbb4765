"""Phasors of 64 records × 40,000 samples × 4 channels, compared with other ways to read or fit them.

Two data sets: pure sines (jointid then fits 3 harmonics) and sines with the harmonics of friction (it
fits 31). Half of the frequencies have whole periods in the window, the others do not. Offset and
white noise of 1e-4 of the amplitude are in every channel, so that no exact fit can be better than the
floor that this noise leaves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import curve_fit

from benchmarks.harness import NOT_INSTALLED, Cell, Table, interleaved, optional, rms
from jointid import SineRecord, extract_phasors

RATE_HZ = 4000.0
NOISE = 1e-4
MANY = 31
COLUMNS = {
    "contender": "",
    "median": "ms",
    "spread": "",
    "× numpy.sum": ".2f",
    "error, whole periods": ".1e",
    "error, broken periods": ".1e",
}


@dataclass(frozen=True)
class Campaign:
    """Records with their true phasors."""

    records: tuple[SineRecord, ...]
    truth: np.ndarray
    """Of the fundamental, shape (r, 4)."""
    whole: np.ndarray
    """Whether whole periods are in the window, shape (r,)."""
    flat: np.ndarray
    """All samples of all records as one array."""

    def channels(self) -> Iterator[tuple[float, np.ndarray]]:
        """Angular frequency per sample, and each (N, 2) array in turn."""
        for record in self.records:
            x = record.omega * record.interval_s
            yield x, record.theta_rad
            yield x, record.tau_Nm


def campaign(records: int, samples: int, harmonics: int) -> Campaign:
    """Sines with odd harmonics that fall as 1/h², like those of a torque that balances friction."""
    rng = np.random.default_rng(64)
    step_hz = RATE_HZ / samples
    whole = np.arange(records) % 2 == 0
    wanted = np.geomspace(3.0, 30.0, records)
    frequencies = np.where(whole, np.maximum(1, np.round(wanted / step_hz)) * step_hz, wanted)
    time = np.arange(samples) / RATE_HZ
    made, truth = [], []
    for frequency in frequencies:
        y = rng.standard_normal(4) + 1j * rng.standard_normal(4)
        waves = np.exp(2j * np.pi * frequency * time)
        signal = np.outer(waves, y).imag + 0.3 * np.abs(y)
        for h in range(3, harmonics + 1, 2):
            turn = np.exp(2j * np.pi * rng.random(4))
            signal += np.outer(waves**h, 0.2 * np.abs(y) * turn / h**2).imag
        signal += NOISE * np.abs(y) * rng.standard_normal(signal.shape)
        made.append(SineRecord(float(frequency), time, signal[:, :2], signal[:, 2:]))
        truth.append(y)
    flat = np.concatenate([x.ravel(order="K") for r in made for x in (r.theta_rad, r.tau_Nm)])
    return Campaign(tuple(made), np.array(truth), whole, flat)


def measure(quick: bool) -> list[Table]:
    """One table without friction, one with."""
    records, samples = (3, 2000) if quick else (64, 40_000)
    tables = []
    for title, harmonics in [("no friction, 3 harmonics", 1), ("friction, 31 harmonics", MANY)]:
        data = campaign(records, samples, harmonics)
        contenders = _contenders(data, harmonics)
        found = {name: call() for name, call in contenders.items()}
        rounds = 1 if quick else 9
        # A fit of 62 sines by lstsq takes a second per record; two rounds of it must do.
        times = interleaved(contenders, against=SUM, rounds=rounds, patience_s=6.0, warm=False)
        rows: list[dict[str, Cell]] = [
            {
                "contender": name,
                "median": each.median,
                "spread": each.spread,
                "× numpy.sum": each.ratio,
                **_errors(data, found[name]),
            }
            for name, each in times.items()
        ]
        if optional("numba") is None:
            rows.append({"contender": f"compiled recurrence (numba): {NOT_INSTALLED}"})
        size = f"{records} records × {samples:,} samples × 4 channels"
        tables.append(Table("phasors", f"Phasors of {size}, {title}", COLUMNS, tuple(rows), (NOTE,)))
    return tables


SUM = "numpy.sum, all samples as one array"
NOTE = (
    "Ratio: median over interleaved rounds. Error: root mean square over records and channels, relative "
    "to the amplitude; at 40,000 samples the noise in the data leaves an error of about 1e-6. jointid's "
    "time includes its search for harmonics, the noise covariance of every harmonic, and the checks of "
    "drift and settling; the others give phasors only."
)


def _contenders(data: Campaign, harmonics: int) -> dict[str, Callable[[], np.ndarray | None]]:
    def flat_sum() -> None:
        data.flat.sum()

    def sum_by_record() -> None:
        for record in data.records:
            # The transposed array is contiguous: the fastest way to sum it.
            record.theta_rad.T.sum()
            record.tau_Nm.T.sum()

    calls: dict[str, Callable[[], np.ndarray | None]] = {
        SUM: flat_sum,
        "numpy.sum, record by record": sum_by_record,
        "**jointid** extract_phasors": lambda: _jointid(data, harmonics),
    }
    if optional("numba") is not None:
        from benchmarks import compiled

        channels = list(data.channels())
        calls["compiled recurrence (numba), 1 thread"] = lambda: compiled.phasors(channels, harmonics)
        calls["compiled recurrence (numba), all cores"] = lambda: compiled.phasors_on_all_cores(
            channels, harmonics
        )
    calls["numpy.fft.rfft, whole periods"] = lambda: _fourier(data)
    calls["numpy.linalg.lstsq per record"] = lambda: _lstsq(data, harmonics)
    if harmonics == 1:
        calls["scipy.optimize.curve_fit per signal"] = lambda: _curve_fit(data)
    return calls


def _jointid(data: Campaign, harmonics: int) -> np.ndarray:
    """Phasors of the fundamental; where there are harmonics, of the fit that holds them."""
    phasors = extract_phasors(data.records)
    return phasors.z if harmonics == 1 else phasors.harmonics[:, 0]


def _fourier(data: Campaign) -> np.ndarray:
    """At its best: the transposed, contiguous array, cut to the nearest whole number of periods."""
    found = []
    for x, signal in data.channels():
        periods = max(1, int(signal.shape[0] * x / (2 * np.pi) + 1e-6))
        length = min(signal.shape[0], round(periods * 2 * np.pi / x))
        lines = np.fft.rfft(signal.T[:, :length], axis=1)
        found.append(2j / length * lines[:, periods])
    return np.array(found).reshape(-1, 4)


def _lstsq(data: Campaign, harmonics: int) -> np.ndarray:
    """At its best: one matrix per record, all four channels as right-hand sides at once."""
    found = []
    for record in data.records:
        t = record.interval_s * np.arange(record.time_s.size)
        arguments = np.outer(t, record.omega * np.arange(1, harmonics + 1))
        A = np.hstack([np.sin(arguments), np.cos(arguments), np.ones((t.size, 1)), t[:, None]])
        y = np.linalg.lstsq(A, np.hstack([record.theta_rad, record.tau_Nm]), rcond=None)[0]
        found.append(y[0] + 1j * y[harmonics])
    return np.array(found)


def _curve_fit(data: Campaign) -> np.ndarray:
    """At its best: frequency known, the model linear, its Jacobian given, started at the truth."""
    found = []
    for record, truth in zip(data.records, data.truth, strict=True):
        t = record.time_s
        sine, cosine = np.sin(record.omega * t), np.cos(record.omega * t)
        jacobian = np.stack([sine, cosine, np.ones_like(t), t], axis=1)

        def model(_t, *p, jacobian=jacobian):
            return jacobian @ p

        def slope(_t, *_p, jacobian=jacobian):
            return jacobian

        signals = np.hstack([record.theta_rad, record.tau_Nm]).T
        row = []
        for signal, y in zip(signals, truth, strict=True):
            p, _ = curve_fit(model, t, signal, p0=[y.real, y.imag, signal.mean(), 0.0], jac=slope)
            row.append(p[0] + 1j * p[1])
        found.append(row)
    return np.array(found)


def _errors(data: Campaign, found: np.ndarray | None) -> dict[str, Cell]:
    if found is None:
        return {}
    error = found / data.truth - 1
    return {
        "error, whole periods": rms(error[data.whole]),
        "error, broken periods": rms(error[~data.whole]),
    }
