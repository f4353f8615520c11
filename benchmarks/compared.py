"""Comparison with the true rotor, and its parameters fitted to results, over many draws of the noise.

`python -m benchmarks.compared --draws 100 --seconds 900` identifies records of the paper's rotor at four speeds, one of
them in a lock, for each seed. It prints how χ² against the true rotor is distributed, χ² against one whose support is
0.2 % stiffer, and how many intervals of the parameters fitted from 3 % off hold the truth.
"""

from __future__ import annotations

import argparse
from time import process_time

import numpy as np
from scipy.stats import kstest

import floquid as fq
from floquid.systems import JeffcottRotor

SPEEDS = (0.45, 0.55, 0.65, 0.85)
TRUE = {"rotor_x": 1.0, "rotor_y": 1.5, "support_x": 1.0, "support_y": 2.0, "damping": 0.004}
PRIOR = 0.01
"""Deviation of what is known of `support_x` before: exponents do not tell a compliance of the shaft from the support's."""


def rotor(values):
    """The rotor of parameters and a period; a stiffness that is none of them is the unit of stiffness."""
    return JeffcottRotor(**{name: values.get(name, 1.0) for name in TRUE}, speed=np.pi / values["period"])


def identified(seed):
    """Models at all speeds from short records with 2 % noise."""
    found = []
    for number, speed in enumerate(SPEEDS):
        how = {"n_periods": 128, "samples_per_period": 16, "noise": 0.02, "seed": 10 * seed + number}
        record = JeffcottRotor(speed=speed).simulate(**how)
        found.append(fq.identify(record, channels=["X", "Y"], validate=False))
    return found


def drawn(seed):
    """χ² and its degrees of freedom against the truth and a stiffer rotor, and the fits without and with a prior."""
    results, generator = identified(seed), np.random.default_rng([seed, 7])
    against = [
        [
            fq.compare(one, JeffcottRotor(speed=speed, support_y=2.0 * (1.0 + off)))
            for one, speed in zip(results, SPEEDS)
        ]
        for off in (0.0, 0.002)
    ]
    start = {name: value * (1.0 + 0.03 * generator.choice([-1.0, 1.0])) for name, value in TRUE.items()}
    before = fq.Parameter(value=1.0 + PRIOR * generator.standard_normal(), prior_std=PRIOR)
    four = {name: value for name, value in start.items() if name != "support_x"}
    return against, [fq.update(rotor, results, given) for given in (start, start | {"support_x": before}, four)]


def main():
    """Print the figures."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--draws", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=np.inf)
    asked = parser.parse_args()
    begin, against, fits = process_time(), [], []
    for seed in range(asked.draws):
        both, fitted = drawn(seed)
        against.append(both)
        fits.append(fitted)
        if process_time() - begin > asked.seconds:
            break
    print(f"{len(fits)} draws, {process_time() - begin:.0f} s")
    for number, name in enumerate(("the true rotor", "0.2 % stiffer")):
        joint = [(sum(one.chi2 for one in own[number]), sum(one.dof for one in own[number])) for own in against]
        each = [one.p for own in against for one in own[number]]
        lost = sum(len(one.missing_in_a) + len(one.missing_in_b) for own in against for one in own[number])
        uncounted = sum(not pair.counted for own in against for one in own[number] for pair in one.pairs)
        print(
            f"{name}: mean χ² {np.mean(joint, axis=0)[0]:.4g} of {np.mean(joint, axis=0)[1]:.4g}; {lost} missing, "
            f"{uncounted} weak; KS of p against uniform: {kstest(each, 'uniform').pvalue:.3g}, a draw each"
        )
        for at, speed in enumerate(SPEEDS):
            those = [own[number][at].p for own in against]
            print(
                f"  at {speed}: mean χ² {np.mean([own[number][at].chi2 for own in against]):.4g}, "
                f"KS {kstest(those, 'uniform').pvalue:.3g}"
            )
    for number, words in enumerate(("of all five", "support_x known to 1 %", "support_x the unit")):
        found = [own[number] for own in fits]
        print(
            f"fits {words}: mean χ² {np.mean([one.chi2 for one in found]):.4g} of {np.mean([one.dof for one in found])}, "
            f"KS of p {kstest([one.p for one in found], 'uniform').pvalue:.3g}, "
            f"steps {np.mean([one.steps for one in found]):.3g}, settled {sum(one.is_converged for one in found)}, "
            f"one direction named in {sum(len(one.unidentifiable) == 1 for one in found)}"
        )
        for name, value in ((name, TRUE[name]) for name in found[0].values):
            known = [one for one in found if np.isfinite(one.values[name])]
            z = np.array([(one.values[name] - value) / one.std[name] for one in known])
            held = (
                f"95 % interval holds {np.sum(np.abs(z) < 1.96)}, rms error {np.sqrt(np.mean(z**2)):.3g}"
                if len(z)
                else ""
            )
            print(f"  {name}: determined {len(known)} of {len(found)}; {held}")


if __name__ == "__main__":
    main()
