"""Comparison with the true rotor, and its parameters fitted to results, over many draws of the noise.

`python -m benchmarks.compared --draws 100 --seconds 900` identifies records of the paper's rotor at four speeds, one of
them in a lock, for each seed. It says how χ² against the true rotor is distributed, χ² against one whose support is
0.2 % stiffer, and how many intervals of the parameters fitted from 3 % off hold the truth.
"""

from __future__ import annotations

import argparse
import sys
from contextlib import suppress
from time import process_time

import numpy as np
from scipy.stats import kstest

import floquid as fq
from floquid.systems import JeffcottRotor

SPEEDS = (0.45, 0.55, 0.65, 0.85)
TRUE = {"rotor_x": 1.0, "rotor_y": 1.5, "support_x": 1.0, "support_y": 2.0, "damping": 0.004}
PRIOR = 0.01
"""Deviation of what is known of `support_x` before: exponents do not tell compliances of shaft and supports apart."""

FITS = ("all five", "all five, support_x known to 1 %", "support_x the unit of stiffness")


def rotor(values):
    """The rotor of parameters and a period; a stiffness that is none of them is the unit of stiffness."""
    return JeffcottRotor(**{name: values.get(name, 1.0) for name in TRUE}, speed=np.pi / values["period"])


def identified(seed):
    """Results at all speeds from short records with 2 % noise."""
    found = []
    for number, speed in enumerate(SPEEDS):
        how = {"n_periods": 128, "samples_per_period": 16, "noise": 0.02, "seed": 10 * seed + number}
        record = JeffcottRotor(speed=speed).simulate(**how)
        found.append(fq.identify(record, channels=["X", "Y"], validate=False))
    return found


def drawn(seed):
    """Comparisons with the true rotor and a stiffer one at each speed, and the three fits."""
    results, generator = identified(seed), np.random.default_rng([seed, 7])
    against = [
        [
            fq.compare(one, JeffcottRotor(speed=speed, support_y=support))
            for one, speed in zip(results, SPEEDS, strict=True)
        ]
        for support in (2.0, 2.004)
    ]
    start = {name: value * (1.0 + 0.03 * generator.choice([-1.0, 1.0])) for name, value in TRUE.items()}
    before = fq.Parameter(value=1.0 + PRIOR * generator.standard_normal(), prior_std=PRIOR)
    four = {name: value for name, value in start.items() if name != "support_x"}
    return against, [fq.update(rotor, results, given) for given in (start, start | {"support_x": before}, four)]


def told_comparisons(name, each):
    """Lines on the comparisons of all draws (draws, speeds)."""
    chi2, dof = (np.array([[getattr(one, what) for one in own] for own in each]) for what in ("chi2", "dof"))
    pairs = [pair for own in each for one in own for pair in one.pairs]
    lost = sum(len(one.missing_in_a) + len(one.missing_in_b) for own in each for one in own)
    ps = np.array([[one.p for one in own] for own in each])
    yield f"{name}: mean χ² {chi2.sum(axis=1).mean():.5g} of {dof.sum(axis=1).mean():.4g}; {lost} modes missing,"
    yield f"  {sum(not pair.counted for pair in pairs)} of {len(pairs)} pairs weak; KS of all p {_ks(ps.ravel()):.3g}"
    for at, speed in enumerate(SPEEDS):
        yield f"  at {speed}: mean χ² {chi2[:, at].mean():.5g} of {dof[:, at].mean():.3g}, KS {_ks(ps[:, at]):.3g}"


def told_fits(name, found):
    """Lines on the fits of all draws."""
    named = sum(len(one.unidentifiable) == 1 for one in found)
    yield f"fit of {name}: mean χ² {np.mean([one.chi2 for one in found]):.4g} of {found[0].dof},"
    yield f"  KS of p {_ks([one.p for one in found]):.3g}; settled {sum(one.is_converged for one in found)},"
    yield f"  steps {np.mean([one.steps for one in found]):.3g}; one direction not determined in {named}"
    for parameter in found[0].values:
        off = [(one.values[parameter] - TRUE[parameter]) / one.std[parameter] for one in found]
        known = np.array(off)[np.isfinite(off)]
        held, rms = np.sum(np.abs(known) < 1.96), np.sqrt(np.mean(known**2)) if len(known) else np.nan
        yield f"  {parameter}: determined in {len(known)}, the 95 % interval holds in {held}; rms error {rms:.3g}"


def _ks(ps):
    return kstest(ps, "uniform").pvalue


def main():
    """Write the figures to the terminal."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--draws", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=np.inf, help="of processor time, after which no draw begins")
    asked = parser.parse_args()
    begin, against, fits = process_time(), [], []
    with suppress(KeyboardInterrupt):  # what there is until then is told
        for seed in range(asked.draws):
            both, fitted = drawn(seed)
            against.append(both)
            fits.append(fitted)
            if process_time() - begin > asked.seconds:
                break
    lines = [f"{len(fits)} draws, {process_time() - begin:.0f} s"]
    for number, name in enumerate(("the true rotor", "support_y 0.2 % stiffer")):
        lines += told_comparisons(name, [own[number] for own in against])
    for number, name in enumerate(FITS):
        lines += told_fits(name, [own[number] for own in fits])
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
