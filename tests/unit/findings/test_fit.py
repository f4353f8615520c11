"""Words on the fit of a record, its period and the test of periodicity that hang on the numbers."""

import pytest

from floquid.findings import note, warning


@pytest.mark.parametrize(
    ("number", "words"), [(1, "One mode is needed: "), (3, "3 modes, a pair counted once, are needed: ")]
)
def test_modes_that_are_needed_are_counted(number, words):
    assert str(note("all_needed", number=number)).startswith(words)


@pytest.mark.parametrize(
    ("loud", "end"), [(False, "0.50 of the limit for noise."), (True, "another tone leave such peaks too.")]
)
def test_a_loud_peak_is_no_noise(loud, end):
    assert str(note("strongest_peak", frequency=1.0, share=0.5, loud=loud)).endswith(end)


@pytest.mark.parametrize(
    ("of", "names"),
    [((2.0,), "the product of those at 2 Hz. A"), ((2.0, 3.5), "the product of those at 2 Hz and 3.5 Hz. A")],
)
def test_a_product_names_the_modes_it_is_of(of, names):
    assert names in str(warning("product", frequency=5.0, of=of))


@pytest.mark.parametrize(
    ("spacings", "families", "words"),
    [
        (1, 1, "One of 6 lines that decay is a multiple of 2.5 Hz away from a stronger one: a sideband of one mode."),
        (4, 2, "4 of 6 lines that decay are multiples of 2.5 Hz away from stronger ones: sidebands of 2 modes."),
    ],
)
def test_lines_are_counted_by_family(spacings, families, words):
    numbers = {"lines": 6, "spacings": spacings, "families": families, "frequency": 2.5, "odds": 3.04}
    said = str(note("line_families", **numbers))
    assert said.startswith(words)
    assert said.endswith("The odds against chance, by frequencies alone, are 1e3.0 to 1.")


def test_lines_that_do_not_decay_are_named():
    said = str(note("undamped_lines", frequencies=(1.25, 2.5), on=1))
    assert said.startswith("Lines that do not decay, at 1.25 and 2.5 Hz, are a steady response")
    assert said.endswith("1 of 2 are at multiples of half the fundamental.")


@pytest.mark.parametrize(
    ("p", "places", "words"),
    [
        (0.01, (0, 0, ""), "p = 0.01, no one harmonic, mode or channel stands out."),
        (0.01, (2, 1, "x"), "p = 0.01, strongest at 2 per period, in mode 1, in channel x."),
        (0.0, (0, 0, "x"), "p < 1e-300, strongest in channel x."),
    ],
)
def test_what_is_periodic_is_placed_where_it_is_strongest(p, places, words):
    harmonic, mode, channel = places
    said = str(note("periodic", p=p, harmonic=harmonic, mode=mode, channel=channel))
    assert said == f"The response is periodic: {words}"


@pytest.mark.parametrize(
    ("most", "size"), [(0.0101, "above 1 % of the mode"), (0.05, "above 1 % (mode 2) to 5 % (mode 1) of the mode")]
)
def test_the_limits_of_modes_are_one_where_they_look_alike(most, size):
    said = str(note("not_periodic", p=0.5, least=0.01, most=most, low=2, high=1, power=0.95))
    assert said == f"Nothing periodic is seen: p = 0.5. Harmonics {size} would show 95 times in 100."
