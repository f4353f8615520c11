"""Floquet analysis beside `scipy.integrate.solve_ivp`: one monodromy matrix, and a map of 2,000 speeds of a rotor.

`make bench` times them; in the ordinary run each is done once, as a test. The ratios at equal error that the
documentation shows are printed by `python benchmarks/test_floquet.py`: options of both sides are chosen so that the
true error of the monodromy matrix, against a reference good to 1e-14, is at most 1e-10, and the largest that does is
taken. There the speeds of the map are integrated by `solve_ivp` for 40 of them alone, and the time is scaled.
"""

import sys
import time

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from floquid.floquet import FunctionMatrix, monodromy, stability_map
from floquid.systems import JeffcottRotor

ERROR = 1e-10
PAPER = JeffcottRotor()
# A depends on the speed through the angle alone: one rotor serves for all of them, given arrays or numbers.
UNIT = JeffcottRotor(speed=1.0)
SPEEDS = np.linspace(0.4, 1.2, 2000)


def system(t, speed):
    return UNIT.system(t * speed)


def lean(t, speed):
    """The same in plain numbers, as one writes it for speed."""
    xx, xy, yy = series(np.cos(2.0 * speed * t), np.sin(2.0 * speed * t))
    return np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0], [-xx, -xy, -0.004, 0.0], [-xy, -yy, 0.0, -0.004]])


def lean_vectorised(t, speed):
    """The same for arrays."""
    xx, xy, yy = series(np.cos(2.0 * speed * t), np.sin(2.0 * speed * t))
    out = np.zeros((*xx.shape, 4, 4))
    out[..., 0, 2] = out[..., 1, 3] = 1.0
    out[..., 2, 0], out[..., 2, 1], out[..., 3, 0], out[..., 3, 1] = -xx, -xy, -xy, -yy
    out[..., 2, 2] = out[..., 3, 3] = -0.004
    return out


def series(c, s):
    """The entries xx, xy, yy of K_R' - K_R' (K_R' + K_F)^-1 K_R'."""
    xx, yy, xy = 1.25 - 0.25 * c, 1.25 + 0.25 * c, -0.25 * s
    sx, sy = xx + 1.0, yy + 2.0
    det = sx * sy - xy * xy
    return (
        xx - (xx * xx * sy - 2.0 * xx * xy * xy + xy * xy * sx) / det,
        xy - (xx * xy * sy - xy * xy * xy - xx * xy * yy + xy * yy * sx) / det,
        yy - (xy * xy * sy - 2.0 * xy * xy * yy + yy * yy * sx) / det,
    )


def half_turn(speed):
    return np.pi / speed


def shot(of, speed, rtol):
    """The monodromy matrix by an explicit Runge-Kutta pair of order 8."""

    def slope(t, x):
        return (of(t, speed) @ x.reshape(4, 4)).ravel()

    run = solve_ivp(slope, (0.0, np.pi / speed), np.eye(4).ravel(), method="DOP853", rtol=rtol, atol=0.01 * rtol)
    return run.y[:, -1].reshape(4, 4)


def ours(of, speed, tolerance):
    return monodromy(lambda t: of(t, speed), np.pi / speed, tolerance=tolerance)


def ours_smooth(of, speed, tolerance):
    """As `ours`, told that nothing short happens within the period."""
    matrix = FunctionMatrix(function=lambda t: of(t, speed), period=np.pi / speed, narrowest=1.0 / 16.0)
    return monodromy(matrix, tolerance=tolerance)


def ours_vectorised(of, speed, tolerance):
    matrix = FunctionMatrix(function=lambda t: of(t, speed), period=np.pi / speed, vectorised=True)
    return monodromy(matrix, tolerance=tolerance)


def mapped(of, tolerance, **options):
    """The growth at all speeds, with neither edges nor thin bands looked for."""
    options = {"refinements": 0, "edge_tolerance": 1.0, "tolerance": tolerance} | options
    return stability_map(of, half_turn, {"speed": SPEEDS}, **options)


def test_the_lean_form_is_the_rotor():
    for t, speed in ((0.3, 0.5), (2.0, 0.7), (5.1, 1.1)):
        exact = JeffcottRotor(speed=speed).system(t)
        assert lean(t, speed) == pytest.approx(exact, abs=1e-14)
        assert lean_vectorised(np.full(2, t), speed)[1] == pytest.approx(exact, abs=1e-14)


@pytest.mark.benchmark(group="monodromy matrix of the paper's rotor, error 1e-10")
def test_one_plain(benchmark):
    assert benchmark(ours, lean, 0.5, 1e-10) == pytest.approx(shot(system, 0.5, 1e-13), abs=ERROR)


@pytest.mark.benchmark(group="monodromy matrix of the paper's rotor, error 1e-10")
def test_one_vectorised(benchmark):
    assert benchmark(ours_vectorised, system, 0.5, 1e-10) == pytest.approx(shot(system, 0.5, 1e-13), abs=ERROR)


@pytest.mark.benchmark(group="monodromy matrix of the paper's rotor, error 1e-10")
def test_one_by_solve_ivp(benchmark):
    assert benchmark(shot, lean, 0.5, 3e-9) == pytest.approx(shot(system, 0.5, 1e-13), abs=3.0 * ERROR)


@pytest.mark.benchmark(group="growth at 2000 speeds")
def test_map_vectorised(benchmark):
    found = benchmark(mapped, system, 1e-10, vectorised=True)
    assert len(found.bands) == 3


@pytest.mark.slow
@pytest.mark.benchmark(group="growth at 2000 speeds")
def test_map_plain(benchmark):
    assert len(benchmark(mapped, lean, 1e-10).bands) == 3


def measured(repeats, function, *arguments, **options):
    """The shortest time of a call [ms], the first left out: what the machine does beside it only adds."""
    function(*arguments, **options)
    times = []
    for _ in range(repeats):
        started = time.perf_counter()
        function(*arguments, **options)
        times.append(time.perf_counter() - started)
    return 1e3 * min(times)


def loosest(method, speeds, options):
    """The largest of the options with which the error at every speed is at most 1e-10, and that error."""
    exact = [shot(lean, speed, 3e-14) for speed in speeds]
    for option in options:
        error = max(np.abs(method(lean, speed, option) - phi).max() for speed, phi in zip(speeds, exact, strict=True))
        if error <= ERROR:
            return option, error
    raise AssertionError(f"no option reaches {ERROR:g}")


def shot_at(of, speeds, rtol):
    return [shot(of, speed, rtol) for speed in speeds]


def compared():
    """Lines of the table."""
    rtols, tolerances = 10.0 ** np.arange(-7.0, -13.0, -0.25), 10.0 ** np.arange(-4.0, -13.0, -1.0)
    some = np.random.default_rng(0).choice(SPEEDS, 40, replace=False)
    chosen = [loosest(*each) for each in ((shot, [0.5], rtols), (shot, some, rtols), (ours, some, tolerances))]
    words = ("solve_ivp, one: rtol", "solve_ivp, map: rtol", "ours: tolerance")
    for name, (option, error) in zip(words, chosen, strict=True):
        yield f"{name} {option:.1e}, error {error:.1e}"
    (rtol, _), (rtol_map, _), (tolerance, _) = chosen
    for name, plain, vectorised in (
        ("JeffcottRotor.system", system, system),
        ("plain numbers", lean, lean_vectorised),
    ):
        yield f"A(t) by {name}: {1e3 * measured(1000, plain, 0.3, 0.5):.1f} us a call"
        theirs = measured(30, shot, plain, 0.5, rtol)
        yield f"  one evaluation      solve_ivp, plain {theirs:9.2f} ms"
        for form, mine in (
            ("plain", measured(100, ours, plain, 0.5, tolerance)),
            ("plain, announced smooth", measured(100, ours_smooth, plain, 0.5, tolerance)),
            ("vectorised", measured(100, ours_vectorised, vectorised, 0.5, tolerance)),
        ):
            yield f"    {form:32} {mine:9.2f} ms  {theirs / mine:6.1f} times as fast"
        theirs = measured(3, shot_at, plain, some, rtol_map) * len(SPEEDS) / len(some)
        yield f"  2,000 speeds        solve_ivp, plain {theirs:9.0f} ms  (40 of them timed, and scaled)"
        for form, mine in (
            ("plain", measured(3, mapped, plain, tolerance)),
            ("plain, announced smooth", measured(3, mapped, plain, tolerance, narrowest=1.0 / 16.0)),
            ("vectorised", measured(5, mapped, vectorised, tolerance, vectorised=True)),
        ):
            yield f"    {form:32} {mine:9.0f} ms  {theirs / mine:6.1f} times as fast"


if __name__ == "__main__":
    for line in compared():
        sys.stdout.write(line + "\n")
        sys.stdout.flush()
