"""One record identified within its limit of time, and what was decided of it."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass

import numpy as np
from benchmarks.chain.run import OutOfTime, compared, counted, limited
from benchmarks.frozen.records import CHAINS, RECORDS
from threadpoolctl import threadpool_limits

from floquid import FloquidError, PeriodicModel
from floquid.findings import Finding, Severity

DIGITS, ROUGH = 10, 3
"""Significant digits of exponents and of their deviations: a tenth of a deviation is then seen in any of them."""

REAL, NEGATIVE, PAIR = "real", "negative", "pair"


@dataclass(frozen=True, slots=True, kw_only=True)
class Mode:
    """One mode of a model, of a pair of conjugates the upper one.

    Parameters
    ----------
    exponent, std
        λ and its deviations, real and imaginary part [1/s].
    kind
        "pair", or "real" or "negative": of a real multiplier.
    harmonics, driven
        Those of the shape, and those at which an input reaches the mode.
    """

    exponent: tuple[float, float]
    std: tuple[float, float]
    kind: str
    harmonics: tuple[int, ...]
    driven: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """What came of one record and seed.

    Parameters
    ----------
    record, seed
        Which it is.
    outcome
        "believed", "refused", "no answer" (out of time) or "failed" (any other error).
    message
        The first line of a refusal or of an error.
    passed
        The verdict; None without a model.
    against, warned
        Codes of the findings that speak against the model, and of the warnings.
    fundamental
        ω = 2π/T of the model [rad/s], modulo i times which exponents are compared.
    modes
        The modes, by frequency.
    must, found, false
        How many of the true modes must be found, were found within four deviations; confident modes that are none.
    seconds, linearisations
        Of the processor, and how often the chain of its kind linearised.
    """

    record: str
    seed: int
    outcome: str
    message: str = ""
    passed: bool | None = None
    against: tuple[str, ...] = ()
    warned: tuple[str, ...] = ()
    fundamental: float = 0.0
    modes: tuple[Mode, ...] = ()
    must: int = 0
    found: int = 0
    false: int = 0
    seconds: float = 0.0
    linearisations: int = 0

    @property
    def name(self) -> str:
        """The record and its seed, as one."""
        return f"{self.record}, {self.seed}"

    @property
    def kind(self) -> str:
        """The key of its chain; that of its name where the record is no more."""
        return RECORDS[self.record].kind if self.record in RECORDS else self.record.split(",")[0]

    @property
    def order(self) -> int:
        """The number of exponents."""
        return sum(2 if mode.kind == PAIR else 1 for mode in self.modes)

    def as_json(self) -> dict:
        """The fields that say something; modes as lists."""
        kept = {name: value for name, value in asdict(self).items() if value not in ((), "", None)}
        return kept | ({"modes": [list(asdict(mode).values()) for mode in self.modes]} if self.modes else {})

    @classmethod
    def of_json(cls, kept: dict) -> Decision:
        """The decision that `as_json` wrote."""
        modes = tuple(
            Mode(
                exponent=tuple(exponent),
                std=tuple(std),
                kind=kind,
                harmonics=tuple(harmonics),
                driven=tuple(driven),
            )
            for exponent, std, kind, harmonics, driven in kept.get("modes", ())
        )
        codes = {name: tuple(kept.get(name, ())) for name in ("against", "warned")}
        return cls(**{**kept, **codes, "modes": modes})


def calibration() -> float:
    """Processor seconds of a fixed calculation of arrays as large as those of the chains, the least of five."""
    generator = np.random.default_rng(0)
    matrix, signal = generator.standard_normal((600, 60)), generator.standard_normal((8, 4096))
    taken = []
    for _ in range(5):
        begin = time.process_time()
        for _ in range(10):
            np.linalg.lstsq(matrix, matrix[:, 0], rcond=None)
            np.fft.fft(np.exp(1j * signal), axis=1)
            sum(value * value for value in signal[0].tolist())
        taken.append(time.process_time() - begin)
    return min(taken)


def decided(record: str, seed: int) -> tuple[Decision, float]:
    """The decision on one record, on one thread, and the calibration just before."""
    frozen = RECORDS[record]
    chain, case = CHAINS[frozen.kind], frozen.make(seed)
    analysis, said = None, {"outcome": "believed"}
    with threadpool_limits(limits=1):
        pace = calibration()
        with counted(chain.function, chain.module) as counter:
            begin = time.process_time()
            try:
                with limited(frozen.limit):
                    analysis = chain.identify(case)
            except OutOfTime:
                said = {"outcome": "no answer"}
            except FloquidError as error:
                said = {"outcome": "refused", "message": str(error).splitlines()[0]}
            except Exception as error:  # noqa: BLE001  # a defect is a decision of its own, not the end of the table
                said = {"outcome": "failed", "message": f"{type(error).__name__}: {error}".splitlines()[0]}
            seconds = round(time.process_time() - begin, 3)
    said |= {"seconds": seconds, "linearisations": counter.calls, "must": int(case.must.sum())}
    if analysis is not None:
        judged = compared(case, analysis.model)
        said |= {name: judged[name] for name in ("found", "false")} | _verdict(analysis) | _model(analysis.model)
    return Decision(record=record, seed=seed, **said), pace


def _verdict(analysis: object) -> dict:
    """The verdict and the codes of its findings: whatever the type of the result, by the fields that it has."""
    validation = getattr(analysis, "validation", None)
    against = [*(() if validation is None else validation.findings), *_of(analysis.findings, Severity.FAILURE)]
    # A fit of lines has no verdict beside its findings.
    passed = getattr(analysis, "passed", not against)
    warned = _of(analysis.findings, Severity.WARNING)
    return {"passed": bool(passed), "against": _codes(against), "warned": _codes(warned)}


def _of(findings: Iterable[Finding], severity: Severity) -> list[Finding]:
    return [finding for finding in findings if finding.severity is severity]


def _codes(findings: Iterable[Finding]) -> tuple[str, ...]:
    return tuple(sorted({finding.code for finding in findings}))


def _model(model: PeriodicModel) -> dict:
    """The modes of a model, by frequency."""
    std = np.zeros(model.order, complex) if model.exponent_std is None else model.exponent_std
    shown = (model.coefficients != 0.0).any(axis=(1, 2))
    inputs = model.inputs
    reached = np.zeros((model.order, 0), bool) if inputs is None else (inputs.coefficients != 0.0).any(axis=1)
    of_inputs = np.zeros(0, int) if inputs is None else inputs.harmonics
    modes = [
        Mode(
            exponent=_rounded(model.exponents[number], DIGITS),
            std=_rounded(std[number], ROUGH),
            kind=_kind(model, number),
            harmonics=tuple(model.harmonics[shown[number]].tolist()),
            driven=tuple(of_inputs[reached[number]].tolist()),
        )
        for number in model.upper_modes
    ]
    modes.sort(key=lambda mode: mode.exponent[::-1])
    return {"modes": tuple(modes), "fundamental": float(f"{model.fundamental:.{DIGITS}g}")}


def _kind(model: PeriodicModel, number: int) -> str:
    if not model.real[number]:
        return PAIR
    return NEGATIVE if model.multipliers[number].real < 0.0 else REAL


def _rounded(value: complex, digits: int) -> tuple[float, float]:
    """Both parts, of so many significant digits."""
    return float(f"{value.real:.{digits}g}"), float(f"{value.imag:.{digits}g}")
