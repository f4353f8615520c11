"""Every modal identifier through the same laws: one table, on noise-free decays of known poles."""

import copy
import dataclasses
import functools
import inspect
import typing

import numpy as np
import pytest
from benchmarks.truth import cramer_rao_bound
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import linear_sum_assignment

import floquid.lti
from floquid.errors import InputError
from floquid.lti import (
    AMI,
    ERA,
    LSCF,
    AbstractIdentifier,
    Ensemble,
    MaximumLikelihood,
    ModalModel,
    Outcome,
    PolyLSCF,
    TimeResponses,
)

TABLE = {
    "ML": MaximumLikelihood(),
    "AMI": AMI(),
    "AMI, any rank": AMI(rank_one=False),
    "AMI, then ML": MaximumLikelihood(initial=AMI()),
    "ERA": ERA(),
    "ERA, then ML": MaximumLikelihood(initial=ERA()),
    "LSCF": LSCF(),
    "LSCF, then ML": MaximumLikelihood(initial=LSCF()),
    "Ensemble": Ensemble(),
    "PolyLSCF": PolyLSCF(),
    "PolyLSCF, any rank": PolyLSCF(rank_one=False),
    "PolyLSCF, then ML": MaximumLikelihood(initial=PolyLSCF()),
}
IDENTIFIERS = list(TABLE.values())
WITHOUT_COVARIANCE = (ERA, LSCF, PolyLSCF)
TWICE = {"AMI, any rank", "AMI, then ML", "LSCF, then ML", "PolyLSCF, any rank"}
"""Each identifier takes part, and a start of each kind for ML: other options have a turn with the slow tests."""


def each(*slow):
    """All identifiers; those that are named `slow` here, whose law others show in less time, with the slow tests."""
    marks = {name: [pytest.mark.slow] * (name in {*TWICE, *slow}) for name in TABLE}
    return pytest.mark.parametrize(
        "identifier", [pytest.param(own, id=name, marks=marks[name]) for name, own in TABLE.items()]
    )


EVERY = each()
DECIDES = pytest.mark.parametrize("identifier", [i for i in IDENTIFIERS if i.decides])
DOES_NOT = pytest.mark.parametrize("identifier", [i for i in IDENTIFIERS if not i.decides])

DT = 0.25
SETS = {
    "pair": (np.exp(-0.02 + 1.0j),),
    "two pairs": (np.exp(-0.02 + 1.0j), np.exp(-0.05 + 2.5j)),
    "positive": (0.95,),
    "negative": (-0.9,),
    "mixed": (np.exp(-0.02 + 1.0j), 0.95, -0.9),
}
EVERY_SET = pytest.mark.parametrize(
    ("identifier", "multipliers"),
    [
        pytest.param(own, own_set, id=f"{name}-{kind}", marks=[pytest.mark.slow] * (name in TWICE or long))
        for name, own in TABLE.items()
        for kind, own_set in SETS.items()
        for long in [(name, kind) == ("AMI", "mixed")]  # more than all others together, of kinds that it meets alone
    ],
)


def decays(multipliers, *, outputs=5, inputs=2, samples=80, seed=0):
    """The multipliers with their conjugates, their residues, and the responses to machine precision.

    An input is an initial condition of one system: the residues of a mode are an outer product.
    """
    generator = np.random.default_rng(seed)
    full, residues = [], []
    for mu in multipliers:
        parts = generator.standard_normal((2, outputs)), generator.standard_normal((2, inputs))
        if np.imag(mu):
            residue = np.outer(*(real + 1j * imag for real, imag in parts))
            full += [mu, np.conj(mu)]
            residues += [residue, residue.conj()]
        else:
            full.append(mu)
            residues.append(np.outer(*(real for real, _ in parts)))
    full, residues = np.array(full, complex), np.array(residues, complex)
    values = np.einsum("roi,rk->oik", residues, full[:, None] ** np.arange(samples)).real
    return full, residues, TimeResponses(values=values, dt=DT, noise=1e-10 * np.abs(values).max(axis=2))


def identified(identifier, data, full):
    """The model, of the order that the identifier finds or, if it does not decide, of the true one."""
    return identifier.extract(identifier.prepare(data), None if identifier.decides else len(full))


@functools.cache
def exact(identifier, multipliers):
    """Their decays, and the model: several laws are of one model."""
    full, _, data = decays(multipliers)
    return full, data, identified(identifier, data, full)


def farthest(found, expected):
    """The largest distance when multipliers are paired so that the sum of distances is least."""
    assert len(found) == len(expected)
    distance = np.abs(np.subtract.outer(found, expected))
    return distance[linear_sum_assignment(distance)].max()


def test_the_table_holds_every_identifier():
    named = [getattr(floquid.lti, name) for name in floquid.lti.__all__]
    classes = {c for c in named if inspect.isclass(c) and issubclass(c, AbstractIdentifier)} - {AbstractIdentifier}
    assert classes == {type(identifier) for identifier in IDENTIFIERS}


def test_the_contract_cannot_be_instantiated():
    with pytest.raises(TypeError, match="abstract"):
        AbstractIdentifier()


@EVERY
def test_it_is_a_final_frozen_object_with_its_options_as_fields(identifier):
    kind = type(identifier)
    assert kind.__bases__ == (AbstractIdentifier,)
    assert getattr(kind, "__final__", False), "mark it @typing.final"
    assert typing.get_type_hints(kind)
    for field in dataclasses.fields(identifier):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(identifier, field.name, None)
    assert dataclasses.replace(identifier) == identifier
    assert not hasattr(identifier, "__dict__")


@EVERY_SET
def test_exact_decays_are_recovered(identifier, multipliers):
    full, _, found = exact(identifier, multipliers)
    assert isinstance(found, ModalModel)
    assert found.outcome is Outcome.SUCCESS
    assert found.dt == DT
    assert farthest(found.multipliers, full) < 1e-10


@EVERY_SET
def test_the_model_gives_the_data_back(identifier, multipliers):
    _, data, found = exact(identifier, multipliers)
    powers = found.multipliers[:, None] ** np.arange(data.values.shape[2])
    back = np.einsum("roi,rk->oik", found.residues, powers)
    assert_allclose(back.imag, 0.0, atol=1e-11)
    assert_allclose(back.real, data.values, atol=1e-9)


@EVERY_SET
def test_conjugates_are_neighbours_and_have_conjugate_residues(identifier, multipliers):
    _, _, found = exact(identifier, multipliers)
    index = 0
    while index < found.order:
        if found.multipliers[index].imag == 0.0:
            assert_array_equal(found.residues[index].imag, 0.0)
            index += 1
        else:
            assert found.multipliers[index + 1] == found.multipliers[index].conj()
            assert_array_equal(found.residues[index + 1], found.residues[index].conj())
            index += 2


@EVERY
@pytest.mark.parametrize("order", [2, 4])
def test_an_order_that_the_data_hold_is_reached(identifier, order):
    full, _, data = decays(SETS["two pairs"][: order // 2])
    found = identifier.extract(identifier.prepare(data), order)
    assert (found.order, found.outcome) == (order, Outcome.SUCCESS)
    assert farthest(found.multipliers, full) < 1e-10


@EVERY
@pytest.mark.first(3)
@pytest.mark.parametrize("order", [1, 3, 5, 2, 4])
def test_the_outcome_says_whether_the_order_was_reached(identifier, order):
    """A pair without noise holds no third pole, and to some algorithms no half of a pair either."""
    _, _, data = decays(SETS["pair"])
    found = identifier.extract(identifier.prepare(data), order)
    assert (found.outcome is Outcome.SUCCESS) == (found.order == order)
    assert found.outcome in {Outcome.SUCCESS, Outcome.ORDER_UNREACHED}


@DECIDES
def test_an_order_that_cannot_be_reached_is_an_outcome(identifier):
    """A single pair without noise cannot be halved, and the residual is rounding."""
    _, _, data = decays(SETS["pair"])
    found = identifier.extract(identifier.prepare(data), 1)
    assert found.outcome is Outcome.ORDER_UNREACHED
    assert found.order != 1


@DOES_NOT
def test_an_order_beyond_the_rank_is_an_outcome(identifier):
    """Responses without noise have as many directions as poles."""
    _, _, data = decays(SETS["pair"])
    found = identifier.extract(identifier.prepare(data), 5)
    assert found.outcome is Outcome.ORDER_UNREACHED
    assert found.order < 5


@DOES_NOT
def test_what_does_not_decide_refuses_to(identifier):
    state = identifier.prepare(decays(SETS["pair"])[2])
    name = type(identifier).__name__
    with pytest.raises(InputError, match=rf"`order` of `{name}\.extract` must .+, but is None\.\n.*initial={name}"):
        identifier.extract(state)


@EVERY
@pytest.mark.parametrize("wrong", [0, -2, 80, 81, 2.0, True, "2"])
def test_an_order_that_is_no_order_is_refused(identifier, wrong):
    state = identifier.prepare(decays(SETS["pair"])[2])
    with pytest.raises(InputError, match=r"^Argument `order` of `\w+\.extract` must .+, but is "):
        identifier.extract(state, wrong)


@EVERY
def test_extracting_is_repeatable_and_leaves_the_data_alone(identifier):
    full, _, data = decays(SETS["pair"])
    before = copy.deepcopy(data.values)
    state, order = identifier.prepare(data), None if identifier.decides else len(full)
    first = identifier.extract(state, order)
    identifier.extract(state, 1)
    again = identifier.extract(state, order)
    assert_array_equal(first.multipliers, again.multipliers)
    assert_array_equal(first.residues, again.residues)
    assert_array_equal(data.values, before)


@EVERY
def test_units_of_the_responses_do_not_matter(identifier):
    """Values and noise times a factor: the same poles, and residues times the factor.

    Of outputs the factor is their unit and of inputs their strength, so that outer products stay outer products.
    """
    full, data, found = exact(identifier, SETS["two pairs"])
    generator = np.random.default_rng(1)
    factor = np.outer(*(10.0 ** generator.uniform(-6, 6, size) for size in data.noise.shape))
    scaled = TimeResponses(values=data.values * factor[..., None], dt=data.dt, noise=data.noise * factor)
    other = identified(identifier, scaled, full)
    assert farthest(found.multipliers, other.multipliers) < 1e-10
    powers = other.multipliers[:, None] ** np.arange(80)
    back = np.einsum("roi,rk->oik", other.residues, powers).real / factor[..., None]
    assert_allclose(back, data.values, atol=1e-9)


@EVERY
def test_the_unit_of_time_does_not_matter(identifier):
    full, data, found = exact(identifier, SETS["two pairs"])
    slow = TimeResponses(values=data.values, dt=8.0 * DT, noise=data.noise)
    other = identified(identifier, slow, full)
    assert_allclose(other.poles, found.poles / 8.0, rtol=1e-12)


@each("AMI")
def test_the_order_of_the_responses_does_not_matter(identifier):
    full, data, found = exact(identifier, SETS["mixed"])
    turned = TimeResponses(values=data.values[::-1, ::-1], dt=DT, noise=data.noise[::-1, ::-1])
    other = identified(identifier, turned, full)
    assert farthest(found.multipliers, other.multipliers) < 1e-10


@EVERY
@pytest.mark.parametrize("lengths", [pytest.param((80, 80), marks=pytest.mark.slow), (37, 80)])
def test_samples_beyond_an_inputs_length_are_not_looked_at(identifier, lengths):
    full, _, data = decays(SETS["two pairs"])
    values = np.array(data.values)
    for hit, length in enumerate(lengths):
        values[:, hit, length:] = 1e3
    data = TimeResponses(values=values, dt=DT, noise=data.noise, lengths=lengths)
    found = identified(identifier, data, full)
    assert farthest(found.multipliers, full) < 1e-10


@EVERY
@pytest.mark.parametrize(
    ("outputs", "inputs", "samples"),
    [(1, 1, 80), (1, 3, 40), (1, 1, 6), (3, 1, 6), (50, 1, 6), (100, 4, 12), (2, 1, 1000)],
)
def test_every_shape_of_data(identifier, outputs, inputs, samples):
    full, _, data = decays(SETS["pair"], outputs=outputs, inputs=inputs, samples=samples)
    found = identified(identifier, data, full)
    assert found.residues.shape == (2, outputs, inputs)
    assert farthest(found.multipliers, full) < 1e-10


@EVERY
def test_a_covariance_where_there_is_one_is_that_of_conjugates_moving_together(identifier):
    """Stacked real parts, then imaginary parts: a conjugate's real part moves alike, its imaginary part against."""
    _, _, found = exact(identifier, SETS["pair"])
    assert (found.covariance is None) == isinstance(identifier, WITHOUT_COVARIANCE)
    if found.covariance is None:
        return
    alike = np.array([[1, 0], [1, 0], [0, 1], [0, -1]])
    own = found.covariance[np.ix_([0, 2], [0, 2])]
    assert_allclose(found.covariance, alike @ own @ alike.T, rtol=1e-9, atol=1e-12 * np.abs(own).max())
    assert (np.linalg.eigvalsh(own) > 0).all()


@EVERY
@pytest.mark.parametrize("name", ["two pairs", "mixed"])
def test_deviations_where_there_are_some_are_the_least_that_there_are(identifier, name):
    """Those of the Cramér-Rao bound at the truth, by a dense matrix: of one input, whose residues are free."""
    full, residues, data = decays(SETS[name], inputs=1)
    noise = np.full((5, 1), 1e-3)
    drawn = data.values + noise[..., None] * np.random.default_rng(2).standard_normal(data.values.shape)
    found = identified(identifier, TimeResponses(values=drawn, dt=DT, noise=noise), full)
    assert (found.covariance is None) == isinstance(identifier, WITHOUT_COVARIANCE)
    if found.covariance is None:
        return
    bound = np.sqrt(np.diag(cramer_rao_bound(full, residues, noise, [80], DT))).reshape(2, -1)
    rows, columns = linear_sum_assignment(np.abs(np.subtract.outer(full, found.multipliers)))
    std = np.sqrt(np.diag(found.covariance)).reshape(2, -1)[:, columns]
    rtol = 0.02 if type(identifier) is MaximumLikelihood else 0.15  # others estimate the noise too
    assert_allclose(std, bound[:, rows], rtol=rtol, atol=1e-12)
    off = (np.log(found.multipliers[columns]) - np.log(full[rows])) / DT
    assert (np.abs([off.real, off.imag]) <= 4.0 * bound + 1e-12).all()
