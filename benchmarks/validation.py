"""The numbers of the page «What floquid reaches»: each function measures one of them and returns the text shown."""

import json
import subprocess
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.signal import lfilter

import floquid as fq
from floquid import order
from floquid.lti import AMI, MaximumLikelihood, TimeResponses
from floquid.testing import pair_exponents

ROOT = Path(__file__).parents[1]
DATA = ROOT / "tests" / "data"
PAGE = ROOT / "docs" / "validation"
"""Where the page finds the numbers."""


def paper_rotor() -> str:
    rotor = fq.systems.JeffcottRotor()
    truth = rotor.exponents()
    upper = np.flatnonzero(truth.imag > 0)
    records = [rotor.simulate(noise=0.02, seed=seed) for seed in range(20)]
    orders, exponent_errors, deviations, pulls, errors = [], [], [], [], []
    for record in records:
        model = fq.identify(record, validate=False).model
        pairs = pair_exponents(model.exponents, truth, model.period)
        std = model.exponent_std[pairs.permutation]
        orders.append(model.order)
        exponent_errors.append(pairs.differences)
        deviations.append(np.concatenate([std.real, std.imag]))
        pulls.append([pairs.differences.real / std.real, pairs.differences.imag / std.imag])
        mass, table = (fq.reconstruct(model, states=s) for s in (["X", "Y"], ["X_tt", "Y_tt"]))
        of_mass, of_table = rotor.system(mass.times), rotor.turntable_system(table.times)
        errors.append([np.abs(mass.system - of_mass).max(), np.abs(table.system - of_table).max()])
    errors = np.array(errors)
    worst = np.abs(np.real(exponent_errors)).max(), np.abs(np.imag(exponent_errors)).max()
    paper = "the paper: 5e-5, 1.4e-4"
    lines = [
        f"order 4 found in {orders.count(4)} of {len(orders)} seeds",
        f"largest error of an exponent: {worst[0]:.1e} (real part), {worst[1]:.1e} (imaginary part) [1/s]; {paper}",
        f"error over its standard deviation, root mean square: {np.sqrt(np.mean(np.square(pulls))):.2f}",
    ]
    for column, states, paper in ((0, "X, Y", 0.013), (1, "X_tt, Y_tt", 0.031)):
        lines.append(
            f"largest error of A(t), states {states}: mean {errors[:, column].mean():.4f}, "
            f"worst seed {errors[:, column].max():.4f}; the paper: {paper}"
        )
    bound = np.mean(deviations)
    lines.append(f"bound: {bound:.2e} for each part of each exponent [1/s]")
    for name, identifier in {"AMI": AMI(), "AMI, then ML": MaximumLikelihood(initial=AMI())}.items():
        orders, found = [], []
        for record in records:
            model = fq.identify(record, identifier=identifier, validate=False).model
            orders.append(model.order)
            gaps = pair_exponents(model.exponents, truth, model.period).differences[upper]
            found.append(np.stack([gaps.real, gaps.imag], axis=1).ravel() / bound)
        found = np.array(found)
        size = np.sqrt(np.mean(found**2, axis=0))
        lines += [
            f"{name}: order 4 in {orders.count(4)} of 20; error over the bound, root mean square",
            f"    of Re λ1, Im λ1, Re λ2, Im λ2: {size.round(2)}, largest {np.abs(found).max():.1f}",
        ]
    model = fq.identify(rotor.simulate(noise=0.0), validate=False).model
    pairs = pair_exponents(model.exponents, truth, model.period)
    state = fq.reconstruct(model, states=["X", "Y"])
    lines.append(
        f"without noise: exponents to {np.abs(pairs.differences).max():.0e}, A(t) to "
        f"{np.abs(state.system - rotor.system(state.times)).max():.0e}, harmonics {model.harmonics.tolist()}"
    )
    return "\n".join(lines)


def lab_rotor(name: str, identifier=None) -> str:
    truth = json.loads((DATA / f"{name}.truth.json").read_text(encoding="utf-8"))
    exponents = np.array([complex(*mode["exponent"]) for mode in truth["modes"]])
    hits = []
    for hit in (1, 2):
        record = fq.read(DATA / f"{name}_hit{hit}.npz", period=truth["period"])
        noise = 0.01 * np.abs(record.values).max(axis=1, keepdims=True)
        noisy = record.values + noise * np.random.default_rng(hit).standard_normal(record.values.shape)
        hits.append(
            fq.Record(values=noisy, sample_rate=record.sample_rate, channels=record.channels, clock=record.clock)
        )
    model = fq.identify(hits, identifier=identifier, validate=False).model
    std, omega = model.exponent_std, model.fundamental
    lines = [
        f"order {model.order}",
        f"{'true':>8} {'found':>8} {'Re λ error':>11} {'Im λ error':>11} [1/s]   in deviations   note",
    ]
    used = set()
    for r in np.flatnonzero(model.exponents.imag > 0):
        gaps = model.exponents[r] - exponents
        gaps -= 1j * omega * np.rint(gaps.imag / omega)
        nearest = int(np.argmin(np.abs(gaps)))
        gap = gaps[nearest]
        used.add(float(round(abs(exponents[nearest].imag) / omega, 4)))
        weak = max(std[r].real, std[r].imag) > 2e-3 * omega
        lines.append(
            f"{abs(exponents[nearest].imag) / omega:8.4f} {abs(model.principal()[r].imag) / omega:8.4f} "
            f"{gap.real:11.4f} {gap.imag:11.4f} {gap.real / std[r].real:11.2f} "
            f"{f'{gap.imag / std[r].imag:.2f}' if std[r].imag else '':>7}   {'weak' if weak else ''}".rstrip()
        )
    missed = sorted({float(round(abs(x.imag) / omega, 4)) for x in exponents} - used)
    return "\n".join([*lines, f"not found: {missed if missed else 'none'}"])


def pulls_of(model, whole):
    """Errors over deviations, real and imaginary parts; None when the order is wrong."""
    if model.order != len(whole):
        return None
    gaps = np.log(model.multipliers)[:, None] - whole[None, :]
    gaps = gaps.real + 1j * (np.mod(gaps.imag + np.pi, 2 * np.pi) - np.pi)
    rows, columns = linear_sum_assignment(np.abs(gaps))
    std = np.sqrt(np.diag(model.covariance)).reshape(2, -1)[:, rows]
    errors = np.stack([gaps[rows, columns].real, gaps[rows, columns].imag])
    return (errors / np.where(std > 0, std, np.inf))[std > 0]


CASES = {
    "three modes": [-0.02 + 0.5j, -0.03 + 1.3j, -0.015 + 2.4j],
    "six modes": [-0.02 + 0.3j, -0.03 + 0.8j, -0.015 + 1.3j, -0.02 + 1.9j, -0.01 + 2.3j, -0.03 + 2.8j],
    "pair a half-power width apart": [-0.02 + 1j, -0.02 + 1.04j],
    "pair, real pole, negative multiplier": [-0.02 + 1j, -0.03 + 0j, complex(-0.05, np.pi)],
}


def responses(exponents, noise, seed):
    """All exponents with their conjugates, and noisy responses."""
    rng = np.random.default_rng(seed)
    whole, values = [], np.zeros((50, 1, 400))
    for s in exponents:
        real = s.imag in (0.0, np.pi)
        shape = rng.standard_normal(50) + (0.0 if real else 1j * rng.standard_normal(50))
        values[:, 0] += (1.0 if real else 2.0) * np.outer(shape, np.exp(s * np.arange(400))).real
        whole += [s] if real else [s, s.conjugate()]
    std = noise * np.abs(values).max(axis=2)
    noisy = values + std[..., None] * rng.standard_normal(values.shape)
    return np.array(whole), TimeResponses(values=noisy, dt=1.0, noise=std)


def synthetic_modes() -> str:
    lines = [f"{'':38s} noise   {'found: AMI':>12s} {'ML':>5s}   {'error over deviation: AMI':>26s} {'ML':>5s}"]
    for case, exponents in CASES.items():
        for noise in (0.02, 0.1):
            shares, sizes = [], []
            for identifier in (AMI(), MaximumLikelihood()):
                trials = []
                for seed in range(10):
                    whole, data = responses(exponents, noise, seed)
                    trials.append(pulls_of(identifier.extract(identifier.prepare(data)), whole))
                right = [t for t in trials if t is not None and np.abs(t).max() < 5]
                shares.append(len(right))
                sizes.append(np.sqrt(np.mean(np.concatenate(right) ** 2)) if right else np.nan)
            lines.append(
                f"{case:38s} {100 * noise:3.0f} %   {shares[0]:9d}/10 {shares[1]:2d}/10   "
                f"{sizes[0]:26.2f} {sizes[1]:5.2f}"
            )
    return "\n".join(lines)


def noise_of(kind, seed):
    """Noise of unit variance (40, 300)."""
    values = np.random.default_rng(1000 + seed).standard_normal((40, 400))
    if kind in ("red", "blue"):
        values = lfilter([1.0], [1.0, -0.8 if kind == "red" else 0.8], values, axis=1)
    if kind == "dependent":
        values = lfilter([1.0], [1.0, -0.9], values, axis=0)
    return values[:, 100:] / values[:, 100:].std()


def noise_of_responses() -> str:
    logs = np.array([-0.02 + 0.8j, -0.03 + 1.7j, -0.04 + 2.6j])
    lines = ["noise       order right   ambiguous   error over deviation   taps   responses are worth"]
    for kind in ("white", "red", "blue", "dependent"):
        choices, sizes = [], []
        for seed in range(20):
            shapes = np.random.default_rng(seed).standard_normal((2, 40, 3))
            values = ((shapes[0] + 1j * shapes[1]) @ np.exp(np.multiply.outer(logs, np.arange(300)))).real
            std = 0.1 * np.abs(values).max()
            noisy = (values + std * noise_of(kind, seed))[:, None]
            choices.append(order.choose(TimeResponses(values=noisy, dt=1.0, noise=np.full((40, 1), std))))
            found = pulls_of(choices[-1].model, np.concatenate([logs, logs.conj()]))
            sizes += [] if found is None else [found]
        lines.append(
            f"{kind:10s} {sum(c.order == 6 for c in choices):5d} of 20 {sum(c.ambiguous for c in choices):6d} of 20 "
            f"{np.sqrt(np.mean(np.concatenate(sizes) ** 2)):15.2f} "
            f"{np.median([c.evidence.whitened for c in choices]):14.0f} "
            f"{np.median([c.evidence.independent for c in choices]):15.0%}"
        )
    return "\n".join(lines)


def noise_of_records() -> str:
    clean = fq.systems.JeffcottRotor().simulate(n_periods=400, samples_per_period=20, noise=0.0)
    exact = fq.identify(clean, validate=False).model
    level = 0.04 * np.abs(clean.values).max(axis=1, keepdims=True)
    lines = ["    a   order right   ambiguous   error over deviation: exponents   harmonics -1, 0, 1"]
    for a in (0.0, 0.6, 0.95, 0.99, -0.7):
        right, doubted, of_exponents, of_shapes = 0, 0, [], []
        for seed in range(10):
            white = np.random.default_rng(seed).standard_normal((clean.n_channels, 1000 + clean.values.shape[1]))
            noise = level * lfilter([np.sqrt(1 - a**2)], [1.0, -a], white, axis=1)[:, 1000:]
            record = fq.Record(
                values=clean.values + noise, sample_rate=clean.sample_rate, channels=clean.channels, clock=clean.clock
            )
            analysis = fq.identify(record, validate=False)
            model, doubted = analysis.model, doubted + analysis.choice.ambiguous
            if model.order != 4:
                continue
            right += 1
            pairs = pair_exponents(model.exponents, exact.exponents, exact.period)
            std = model.exponent_std[pairs.permutation]
            of_exponents += [pairs.differences.real / std.real, pairs.differences.imag / std.imag]
            for m in (-1, 0, 1):
                here, there = np.flatnonzero(model.harmonics == m)[0], np.flatnonzero(exact.harmonics == m)[0]
                off = model.coefficients[pairs.permutation][..., here] - exact.coefficients[..., there]
                std = model.coefficient_std[pairs.permutation][..., here]
                of_shapes += [off.real / std.real, off.imag / std.imag]
        lines.append(
            f"{a:5.2f} {right:7d} of 10 {doubted:6d} of 10 {np.sqrt(np.mean(np.square(of_exponents))):22.2f} "
            f"{np.sqrt(np.mean(np.square(of_shapes))):27.2f}"
        )
    return "\n".join(lines)


def equal_multipliers() -> str:
    logs, lines = np.array([-0.02 + 1j, -0.02 + 1j, -0.03 + 2j]), []
    for hits in (1, 2, 3):
        choices, sizes = [], []
        for seed in range(10):
            rng = np.random.default_rng(seed)
            shapes, shares = rng.standard_normal((2, 40, 3)), rng.standard_normal((2, 3, hits))
            products = np.einsum("om,mi->oim", shapes[0] + 1j * shapes[1], shares[0] + 1j * shares[1])
            values = (products @ np.exp(np.multiply.outer(logs, np.arange(300)))).real
            std = 0.02 * np.abs(values).max()
            noisy = values + std * rng.standard_normal(values.shape)
            data = TimeResponses(values=noisy, dt=1.0, noise=np.full(values.shape[:2], std))
            choices.append(order.choose(data))
            found = pulls_of(choices[-1].model, np.concatenate([logs, logs.conj()]))
            sizes += [] if found is None else [found]
        orders = [c.order for c in choices]
        size = f", error over deviation {np.sqrt(np.mean(np.concatenate(sizes) ** 2)):.2f}" if sizes else ""
        lines.append(
            f"{hits} hit{'s' * (hits > 1)}: order 4 in {orders.count(4)} of 10, order 6 in {orders.count(6)}, "
            f"ambiguous in {sum(c.ambiguous for c in choices)}{size}\n    {choices[-1].reasons[-1]}"
        )
    return "\n".join(lines)


def many_responses() -> str:
    rng = np.random.default_rng(0)
    logs = np.array([-0.012 + 0.8j, -0.018 + 1.7j, -0.015 + 2.4j])
    shapes = rng.standard_normal((2, 20000, 3))
    values = rng.standard_normal((20000, 1, 1024))
    values[:, 0] += ((shapes[0] + 1j * shapes[1]) @ np.exp(np.multiply.outer(logs, np.arange(1024)))).real
    values.flags.writeable = False  # taken as it is, not copied
    data, identifier = TimeResponses(values=values, dt=1.0), MaximumLikelihood()
    tracemalloc.start()
    begin = time.process_time()
    model = identifier.extract(identifier.prepare(data))
    seconds, memory = time.process_time() - begin, tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    gaps = pair_exponents(model.poles, np.concatenate([logs, logs.conj()]), 1.0).differences
    return (
        f"order {model.order}, largest error {np.abs(gaps).max():.1e} a sample\n{seconds:.1f} s of one processor, "
        f"{memory / 1e6:.0f} MB beyond the {values.nbytes / 1e6:.0f} MB of the data"
    )


SECTIONS: dict[str, Callable[[], str]] = {
    "paper_rotor": paper_rotor,
    "1900rpm": lambda: lab_rotor("rotor_1900rpm"),
    "1900rpm_ami": lambda: lab_rotor("rotor_1900rpm", AMI()),
    "650rpm": lambda: lab_rotor("rotor_650rpm"),
    "650rpm_ami": lambda: lab_rotor("rotor_650rpm", AMI()),
    "synthetic_modes": synthetic_modes,
    "noise_of_responses": noise_of_responses,
    "noise_of_records": noise_of_records,
    "equal_multipliers": equal_multipliers,
    "many_responses": many_responses,
}


def write(section: str) -> str:
    """Measure a section and write its text, with the commit that it was measured at, to where the page reads it."""
    text = SECTIONS[section]()
    commit = _git("rev-parse", "--short=7", "HEAD").stdout.strip()
    changed = ", and changes" if _git("diff", "--quiet", "HEAD", "--", "src", "benchmarks").returncode else ""
    PAGE.mkdir(exist_ok=True)
    (PAGE / f"{section}.txt").write_text(f"{text}\n# at commit {commit}{changed}\n", encoding="utf-8")
    return text


def _git(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False)
