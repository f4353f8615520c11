"""Models over a range of orders, prepared once: which of their poles stay, and how well each fits."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from floquid._arrays import Complexes, Floats, Integers
from floquid._checks import input_error, integer, wrong_value
from floquid.lti import ERA, AbstractIdentifier, ModalModel, Outcome, TimeResponses, fit_residues, weighted_blocks
from floquid.order._types import Criteria, OrderScan, Stability, Tolerances, both_compressed, indicators_of

MOST = 40  # the highest order of a scan whose orders are not given

DEFAULT = Tolerances()


def scan(
    data: TimeResponses,
    identifier: AbstractIdentifier | None = None,
    orders: Sequence[int] | None = None,
    *,
    tolerances: Tolerances = DEFAULT,
    report: Callable[[str], None] = lambda _: None,
) -> OrderScan:
    """Identify at each of several orders, and see which poles stay.

    The data are looked at through their principal responses (`lti.compress`), which neither the poles nor their
    stability can tell from the data; the identifier prepares once, except for those of a rational function without a
    degree of their own: their degree grows with the order, since the strongest roots of one denominator would agree
    with themselves. The poles of each order are held against those of
    the next lower order reached (see `stability`). An order that is not reached is kept, takes no part in the
    comparison, and its poles count as new: the same model under two orders would agree with itself.

    That poles agree between orders is evidence only for an identifier that finds each order afresh, as `ERA` does.
    `MaximumLikelihood` and `AMI` add poles to those they have: there, poles of noise stay too.

    Raises InputError where an order is not possible, or `identifier` is none.

    Parameters
    ----------
    data
        The responses and their noise.
    identifier
        The algorithm; None for `ERA`.
    orders
        The orders, positive and below the number of samples; 2, 4, … up to half of the samples and at most 40 when not
        given.
    tolerances
        When poles of neighbouring orders count as one.
    report
        Is told of each stage.
    """
    chosen = ERA() if identifier is None else identifier
    if not isinstance(chosen, AbstractIdentifier):
        must = "be an identifier of `floquid.lti`, or None"
        raise wrong_value("identifier", "scan", must, identifier, "Pass an object, such as ERA().")
    listed = _orders(orders, int(data.lengths.max()))
    report("compressing the responses")
    exact, product = both_compressed(data)
    principal = product if _rank_one(chosen) else exact
    report("looking at spectra and singular values")
    found = indicators_of(data, exact, product)
    report("preparing the identification")
    state = chosen.prepare(principal)
    models = []
    for order in listed:
        report(f"scanning: order {order}")
        own = chosen.of_order(order)
        models.append(own.extract(state if own is chosen else own.prepare(principal), order))
    return OrderScan(
        orders=listed,
        models=tuple(models),
        stable=_compared(models, tolerances),
        criteria=criteria(models, principal, data),
        indicators=found,
        tolerances=tolerances,
    )


def _orders(orders: Sequence[int] | None, samples: int) -> tuple[int, ...]:
    """The orders, ascending and each once."""
    if orders is None:
        most = min(MOST, samples // 2)
        return tuple(range(2, most + 1, 2)) or (1,)
    if isinstance(orders, (str, bytes)) or not isinstance(orders, Sequence | range | np.ndarray) or not len(orders):
        raise wrong_value("orders", "scan", "be a list of positive integers", orders, "Pass e.g. range(2, 42, 2).")
    listed = sorted({integer(order, "orders", "scan", at_least=1) for order in orders})
    if listed[-1] >= samples:
        remedy = "Record more samples, or ask for fewer poles."
        raise input_error("orders", "scan", f"be less than the {samples} samples", f"has {listed[-1]}", remedy)
    return tuple(listed)


def _rank_one(identifier: AbstractIdentifier) -> bool:
    """True where the identifier, or the one it wraps, takes the residues of several inputs for outer products."""
    wrapped = getattr(identifier, "initial", None)
    return bool(getattr(identifier, "rank_one", False)) or (wrapped is not None and _rank_one(wrapped))


def _compared(models: Sequence[ModalModel], tolerances: Tolerances) -> tuple[Integers, ...]:
    """The stability of each model's poles against the last model before it that reached its order."""
    levels, lower = [], None
    for model in models:
        reached = model.outcome is Outcome.SUCCESS
        if reached and lower is not None:
            levels.append(stability(model, lower, tolerances=tolerances))
        else:
            levels.append(np.zeros(model.order, dtype=np.int64))
        lower = model if reached else lower
    return tuple(levels)


def criteria(models: Sequence[ModalModel], principal: TimeResponses, data: TimeResponses) -> Criteria:
    r"""The fit of each model to the data behind its principal responses.

    .. math:: c_n = \operatorname{tr}\big((I - P_n) W^T W\big), \qquad
              \mathrm{AIC} = N \ln\frac{c_n}{N} + 2 p, \qquad
              \mathrm{BIC} = N \ln\frac{c_n}{N} + n \ln N + n O \sum_i \ln N_i

    with N = O Σ N_i numbers of O outputs, p = n (1 + O I) real parameters of n poles and their residues, and the level
    of the noise free. A residue is told by the N_i samples of its own response alone, which is what it is charged for
    (Schwarz 1978, with each parameter's own sample size). With many outputs AIC is close to the chi-square test
    of `MaximumLikelihood`; BIC misses weak modes there.
    """
    n_outputs, samples = data.n_outputs, int(data.lengths.sum())
    numbers = n_outputs * samples
    energy, beyond = float(np.sum(principal.values**2)), 0.0
    if principal.n_outputs < min(n_outputs, samples):
        # Principal responses were left out: what they hold is never explained.
        beyond = max(sum(float(np.sum(block**2)) for block in weighted_blocks(data)) - energy, 0.0)
    cost = np.full(len(models), beyond)
    for place, model in enumerate(models):
        best = fit_residues(model.multipliers, principal)
        assert best.residual_std is not None
        cost[place] += np.sum(best.residual_std**2 * np.maximum(principal.lengths - best.order, 1))
    orders = np.array([model.order for model in models])
    parameters = orders * (1 + n_outputs * data.n_inputs)
    fitted = numbers * np.log(np.maximum(cost, np.finfo(float).tiny) / numbers)
    spread = float(n_outputs * np.log(principal.lengths).sum())
    return Criteria(
        cost=cost,
        left=cost / max(energy + beyond, np.finfo(float).tiny),
        aic=fitted + 2.0 * parameters,
        bic=fitted + orders * (np.log(numbers) + spread),
        degrees=numbers - parameters,
    )


def mac(a: Complexes, b: Complexes) -> Floats:
    """|aᴴb|²/(aᴴa · bᴴb) for each row of `a` (m, entries) and of `b` (n, entries): (m, n); 0 where one is zero."""
    lengths = np.outer(np.sum(np.abs(a) ** 2, axis=1), np.sum(np.abs(b) ** 2, axis=1))
    cross = np.abs(a.conj() @ b.T) ** 2
    return np.divide(cross, lengths, out=np.zeros_like(cross), where=lengths > 0)


def paired(misfit: Floats) -> tuple[Integers, Integers]:
    """The rows and columns that belong together: the assignment of the least total misfit."""
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(misfit)
    return rows, columns


def stability(
    model: ModalModel, lower: ModalModel, *, noise: Floats | None = None, tolerances: Tolerances = DEFAULT
) -> Integers:
    r"""The `Stability` of each pole (modes,): how far it agrees with one of a lower order.

    .. math:: |\theta_a - \theta_b|_{2\pi} \le 2\pi f, \qquad |d_a - d_b| \le \max(\epsilon\, d, d_0), \qquad
              \frac{|R_a^H R_b|^2}{(R_a^H R_a)(R_b^H R_b)} \ge m

    with μ = exp(-d + iθ) and R the residues over their noise, all outputs and inputs in one vector. Poles are paired
    one to one by the least total misfit, angles going round at π. Real multipliers pair with real ones of their sign;
    they have no frequency, and their decay alone is compared.

    Gates on the shape itself that are common elsewhere, such as the modal phase collinearity or the mean phase
    deviation, are not used: the shapes of lifted responses are fully complex, and every true mode would be rejected.

    Raises InputError where the models are not of the same responses.

    Parameters
    ----------
    model
        The model whose poles are judged.
    lower
        The model of the next lower order, of the same responses.
    noise
        The standard deviation of the noise on each response (outputs, inputs); alike where not given.
    tolerances
        When two poles count as one.
    """
    if model.residues.shape[1:] != lower.residues.shape[1:]:
        must, got = "be of the same responses", f"has {lower.residues.shape[1:]} instead of {model.residues.shape[1:]}"
        raise input_error("lower", "stability", must, got, "Both models must come from one scan.")
    levels = np.zeros(model.order, dtype=np.int64)
    if not model.order or not lower.order:
        return levels
    weight = 1.0 if noise is None else 1.0 / noise
    shapes = [(one.residues * weight).reshape(one.order, -1) for one in (model, lower)]
    turn, decay = _misfits(model.multipliers, lower.multipliers, tolerances)
    shape = (1.0 - mac(*shapes)) / (1.0 - tolerances.shape)
    misfits = np.stack([turn, decay, shape])
    # Beyond a tolerance two poles are just as far: one that is lost pushes no other off its match. One that is missed
    # costs as much as all that are met: what is within all of them is no better match elsewhere.
    rows, columns = paired(np.where(misfits > 1.0, len(misfits), misfits).sum(axis=0))
    met = misfits[:, rows, columns] <= 1.0
    levels[rows] = np.cumprod(met, axis=0).sum(axis=0)
    # Equal angles of real multipliers say nothing by themselves.
    real = model.multipliers[rows].imag == 0
    levels[rows[real & (levels[rows] == Stability.FREQUENCY)]] = Stability.NEW
    return levels


def _misfits(here: Complexes, there: Complexes, tolerances: Tolerances) -> tuple[Floats, Floats]:
    """The differences of the angles and of the decays in tolerances (m, n); infinite between unlike kinds."""
    tiny = np.finfo(float).tiny
    a, b = (np.asarray(np.log(np.where(np.abs(mu) < tiny, tiny, mu)), dtype=np.complex128) for mu in (here, there))
    larger = np.maximum(np.abs(a.real)[:, None], np.abs(b.real))
    wrapped = np.mod(np.subtract.outer(a.imag, b.imag) + np.pi, 2.0 * np.pi) - np.pi
    turn = np.abs(wrapped) / np.maximum(2.0 * np.pi * tolerances.frequency, tolerances.damping * larger)
    decay = np.abs(np.subtract.outer(a.real, b.real)) / np.maximum(tolerances.damping * larger, tolerances.decay)
    unlike = np.not_equal.outer(here.imag == 0, there.imag == 0)
    return np.where(unlike, np.inf, turn), np.where(unlike, np.inf, decay)
