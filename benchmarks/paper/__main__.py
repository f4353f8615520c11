"""The paper's figures and numbers into a folder: `python -m benchmarks.paper --out build/paper`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks.paper import Reproduction, figures, numbers, page, reproduce

from floquid.plot import save_figure


def write(done: Reproduction, folder: Path) -> Path:
    """Write paper.md, the figures beside the paper's words and the table of numbers, and the pictures it shows."""
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    drawn = figures(done)
    names = {figure.number: f"figures/paper_{figure.number}.png" for figure in drawn}
    for figure in drawn:
        save_figure(figure.figure, folder / names[figure.number])
    text = page(drawn, numbers(done), lambda figure: names[figure.number])
    (folder / "paper.md").write_text(text, encoding="utf-8")
    return folder / "paper.md"


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.paper", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("build/paper"), help="a folder")
    parser.add_argument("--draws", type=int, default=10, help="draws of the noise that errors are taken over")
    parser.add_argument("--periods", type=int, default=1024, help="length of the record; the paper's is 1024")
    parser.add_argument("--noise", type=float, default=0.02, help="over the largest response; the paper's is 0.02")
    parser.add_argument("--seed", type=int, default=0, help="the seed of the first draw")
    options = parser.parse_args(arguments)
    done = reproduce(
        seed=options.seed,
        draws=options.draws,
        n_periods=options.periods,
        noise=options.noise,
        report=lambda words: sys.stderr.write(f"{words}\n"),
    )
    sys.stdout.write(f"{write(done, options.out)}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
