"""Output of `floquid floquet`: tables and a verdict for a person, `summary.json` and `modes.npz` for a program."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from floquid._checks import counted
from floquid._json import attributes
from floquid.cli.output.terminal import (
    json_text,
    new_table,
    print_files,
    print_title,
    print_warnings,
    print_whole,
    terminal,
)
from floquid.floquet import (
    FloquetModes,
    HillModes,
    MatrixFile,
    Stability,
    multiplier_is_real,
    state_participation,
    upper_modes,
)

FILES = ("summary.json", "modes.npz", "figures/exponents.png", "figures/shapes.png")

LEGEND = (
    "A row with ± is a conjugate pair. λ: Floquet exponent, on the branch of the strongest harmonic of its shape. "
    "f = |λ|/2π, ζ = -Re λ/|λ|. |μ| = e^(Re λ T): growth in one period. folded: |Im λ| modulo ω, over ω"
)
NOTES = {
    "μ<0": "a negative real multiplier, no pair",
    "μ>0": "a positive real multiplier, no pair",
    "grows": "unstable",
    "rests": "neither grows nor decays within its error: the sign of Re λ is not determined",
    "shared": "shares its shape with another: their mean is right, each alone less so",
}
SHARES = (
    "m: the strongest harmonics of the shape, with their share of its mean square. states: the strongest, with their "
    "participation factors, which no unit changes"
)
AGREE = 1e-6  # of max(|λ|, ω): by how much the two routes may differ, where both claim to be right
_HILL = 1e-10  # of max(|λ|, ω): to what `hill` settles unless told otherwise
_SHORTER = {"First time derivative of ": "d/dt ", " bending-mode DOF": "", " DOF": ""}

_MOST_ROWS, _HARMONICS, _STATES, _LONGEST = 60, 3, 4, 60


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Examined:
    """All that the command found."""

    file: MatrixFile
    modes: FloquetModes
    stability: Stability
    hill: HillModes | None
    difference: np.ndarray | None  # that of each exponent from Hill's method (modes,) [1/s]
    unchecked: str  # why there is none where it was asked for
    halved: tuple[float, str] | None
    """The largest difference of the exponents of every other azimuth [1/s], or NaN and why not."""

    @property
    def worst(self) -> float | None:
        """The largest difference from Hill's method [1/s]."""
        return None if self.difference is None else float(self.difference.max())

    @property
    def claimed(self) -> np.ndarray:
        """To what the two routes claim to agree (modes,) [1/s]."""
        assert self.hill is not None
        return self.stability.margins + hill_claims(self.modes, self.hill)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings, a sentence each."""
        words = list(self.file.warnings)
        if self.modes.defective:
            listed = ([f"{self.modes.exponents[r]:.6g}" for r in group] for group in self.modes.defective)
            groups = "; ".join(", ".join(group) for group in listed)
            why = self.modes.outcome.value
            words.append(f"These exponents share a shape, or nearly: {groups}. {why[0].upper()}{why[1:]}.")
        if self.unchecked:
            words.append(f"Hill's method gave no second opinion: {self.unchecked}")
        elif self.hill is not None and self.difference is not None:
            if not self.hill.converged:
                words.append(
                    f"Hill's method has not settled, its exponents differ by up to {self.worst:.2g} 1/s: "
                    f"{self.hill.outcome.value}"
                )
            elif (self.difference > self.claimed).any():
                words.append(
                    f"Hill's method disagrees: its exponents differ by up to {self.worst:.2g} 1/s, more than both "
                    f"routes claim ({self.claimed[(self.difference / self.claimed).argmax()]:.2g} 1/s). The verdict is "
                    "that of the integration; lower --tolerance."
                )
        return tuple(words)


def hill_claims(modes: FloquetModes, found: HillModes) -> np.ndarray:
    """Accuracy that Hill's method claims for its exponents, with a margin of ten (modes,) [1/s]."""
    size = np.maximum(np.abs(modes.exponents), modes.fundamental)
    return 10.0 * (_HILL * size + float(found.change.max()))


def print_examined(found: Examined, out: Path | None) -> None:
    """A(t), the verdict, the modes, what they are made of, and the checks."""
    console, modes = terminal(), found.modes
    console.print(
        f"A(t): {counted(modes.order, 'state')}; period {modes.period:.8g} s (ω = {modes.fundamental:.6g} rad/s); "
        f"{found.file.source}."
    )
    shown = print_stability(console, modes, found.stability)
    print_title(console, "Shapes")
    console.print(_shapes_table(found, shown))
    console.print(f"{SHARES}.", style="dim")
    if len(shown) < len(upper_modes(modes)):
        words = f"These are the {_MOST_ROWS} of slowest decay, of {len(upper_modes(modes))}"
        console.print(f"{words}: summary.json has all (--out DIR or --format json).")
    _print_checks(console, found)
    print_warnings(console, found.warnings)
    print_files(out, FILES, "to keep the modes and the figures")


def print_stability(console: Console, modes: FloquetModes, stability: Stability) -> list[int]:
    """Print the verdict and the modes, and return those that are in the table."""
    print_title(console, f"Stability: {stability.verdict.value}")
    for reason in stability.reasons:
        console.print(reason)
    shown = upper_modes(modes)
    if len(shown) > _MOST_ROWS:
        shown = sorted(shown, key=lambda r: -modes.exponents[r].real)[:_MOST_ROWS]
    print_title(console, f"Modes: order {modes.order}, conjugates counted one by one")
    print_whole(console, _modes_table(modes, stability, shown))
    used = {word for r in shown for word in _notes(modes, stability, r)}
    console.print("; ".join([LEGEND, *(f"{w}: {m}" for w, m in NOTES.items() if w in used)]) + ".", style="dim")
    return shown


def _print_checks(console: Console, found: Examined) -> None:
    """Print the result of Hill's method, and the azimuths of a turbine."""
    model = found.file.linearisation
    agrees = found.hill is not None and found.hill.converged
    if agrees or model is not None:
        print_title(console, "Checks")
    if agrees and found.hill is not None:
        console.print(
            f"Hill's method, which integrates nothing, finds the same exponents to {found.worst:.2g} 1/s "
            f"(±{found.hill.n_harmonics} harmonics)."
        )
    if model is None or found.halved is None:
        return
    resolution, (distance, why) = model.resolution(), found.halved
    console.print(f"The azimuths {'resolve' if resolution.resolved else 'do not resolve'} A(t).")
    for reason in resolution.reasons:
        console.print(f"  {reason}")
    if why:
        console.print(f"  Every other azimuth alone could not be tried: {why}")
    else:
        console.print(f"  Every other azimuth alone gives exponents that differ by up to {distance:.2g} 1/s.")
    for name in model.set_aside:
        console.print(f"Set aside, as the phase of the period: {_short(name)}.")


def _modes_table(modes: FloquetModes, stability: Stability, shown: list[int]) -> Table:
    """The modes, a conjugate pair a row."""
    table = new_table([""], ["Re λ [1/s]", "Im λ [rad/s]", "f [Hz]", "ζ [%]", "|μ|", "folded"], ["note"])
    sizes, folded = np.abs(modes.multipliers), np.abs(modes.principal().imag) / modes.fundamental
    for number, r in enumerate(shown, start=1):
        value, notes = modes.exponents[r], _notes(modes, stability, r)
        rests = "rests" in notes
        table.add_row(
            str(number),
            f"{value.real:+.1e}" if rests and value.real else f"{value.real:.6g}",
            ("" if multiplier_is_real(modes, r) else "±") + f"{abs(value.imag):.6g}",
            f"{abs(value.imag) / (2.0 * np.pi) if rests else modes.frequencies_hz[r]:.5g}",
            f"{100 * modes.damping_ratios[r]:+.1e}" if rests and value.real else f"{100 * modes.damping_ratios[r]:.3g}",
            f"{sizes[r]:.4g}",
            f"{folded[r]:.4f}",
            " ".join(notes),
        )
    return table


def _notes(modes: FloquetModes, stability: Stability, mode: int) -> list[str]:
    """The words of `NOTES` that a mode deserves."""
    value, margin = modes.exponents[mode], stability.margins[mode]
    negative = multiplier_is_real(modes, mode) and round(2.0 * abs(value.imag) / modes.fundamental) % 2 == 1
    deserved = {
        "μ<0": negative,
        "μ>0": multiplier_is_real(modes, mode) and not negative,
        "grows": value.real > margin,
        "rests": abs(value.real) <= margin,
        "shared": any(mode in group for group in modes.defective),
    }
    return [word for word in NOTES if deserved[word]]


def _shapes_table(found: Examined, shown: list[int]) -> Table:
    """Table of the harmonics and states that take part in each mode."""
    modes, shares = found.modes, state_participation(found.modes)
    table = new_table([""], [], ["m", "states"])
    table.columns[1].no_wrap = True
    for number, r in enumerate(shown, start=1):
        harmonics = [
            f"{modes.harmonics[k]:+d}: {100 * modes.participation[r, k]:.3g}%".replace("+0", "0")
            for k in np.argsort(-modes.participation[r], kind="stable")[:_HARMONICS]
            if modes.participation[r, k] >= 5e-4
        ]
        states = [
            f"{_short(found.file.states[k])} {100 * shares[r, k]:.0f}%"
            for k in np.argsort(-shares[r], kind="stable")[:_STATES]
            if shares[r, k] >= 0.01
        ]
        table.add_row(str(number), ", ".join(harmonics), ", ".join(states))
    return table


def _short(name: str) -> str:
    """A state's name without what OpenFAST says of its own tables."""
    name = name.partition(" (internal DOF index")[0]
    for long, short in _SHORTER.items():
        name = name.replace(long, short)
    return name if len(name) <= _LONGEST else f"{name[: _LONGEST - 1]}…"


def summary_text(found: Examined) -> str:
    """`summary.json` as text."""
    modes, model = found.modes, found.file.linearisation
    content = {
        "format": "floquid-floquet/1",
        **attributes(modes, "period", "order"),
        "modes": [_mode(modes, r) for r in range(modes.order)],
        "stability": {
            "verdict": found.stability.verdict.name.lower(),
            **attributes(found.stability, "growth", "reasons"),
        },
        "check": None
        if found.hill is None
        else {
            "method": "hill",
            "difference": found.worst,
            "n_harmonics": found.hill.n_harmonics,
            "outcome": found.hill.outcome.name.lower(),
        },
        "defective": modes.defective,
        "azimuths": None if model is None else _azimuths(found),
        **attributes(found.file, "states", "source"),
        "warnings": found.warnings,
    }
    return json_text(content)


def _azimuths(found: Examined) -> dict[str, Any]:
    """Entry on whether the azimuths of a turbine resolve A(t)."""
    model = found.file.linearisation
    assert model is not None
    assert found.halved is not None
    resolution = model.resolution()
    return {
        "count": model.azimuths.size,
        **attributes(resolution, "equally_spaced", "resolved", "tail", "reasons"),
        "every_other": None if found.halved[1] else found.halved[0],
        "set_aside": model.set_aside,
    }


def _mode(modes: FloquetModes, r: int) -> dict[str, Any]:
    kept = np.flatnonzero(modes.participation[r] >= 1e-12 * modes.participation[r].max())
    kept = np.arange(kept[0], kept[-1] + 1)
    return {
        "exponent": modes.exponents[r],
        "exponent_std": None,
        "principal": modes.principal()[r],
        # One may be beyond what a number holds.
        "multiplier": modes.multipliers[r] if np.isfinite(modes.multipliers[r]) else None,
        "frequency_hz": modes.frequencies_hz[r],
        "damping_ratio": modes.damping_ratios[r],
        "harmonics": modes.harmonics[kept],
        "participation": modes.participation[r, kept],
    }


def save_modes(found: Examined, path: Path) -> None:
    """`modes.npz`: the modes as arrays."""
    modes = found.modes
    with path.open("wb") as stream:
        arrays = {name: getattr(modes, name) for name in ("exponents", "coefficients", "harmonics", "period")}
        np.savez(stream, **arrays, states=np.array(found.file.states))
