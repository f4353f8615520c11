"""The whole chain: records → modes → periodic model → state matrix, with every intermediate kept."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Unpack

import numpy as np

from floquid.core import PeriodicModel, Record, common_point, on_branch, unevenness
from floquid.errors import IdentificationError, UnevenError
from floquid.findings import Finding, note, texts, warning
from floquid.fit import HALF_DIGITS, RARE, chi2_limit
from floquid.pipeline._analysis import Analysis
from floquid.pipeline._sums import SumError, look_for_sums, without
from floquid.pipeline.excited import identified_ambient, identified_driven
from floquid.pipeline.free import identified_free
from floquid.preparation import (
    Options,
    Prepared,
    Settings,
    blas_threads,
    own_names,
    prepare,
    settings_of,
    takes_settings,
)

OF = "identify"

Chain = Callable[[Prepared, Callable[[str], None]], Analysis]

CHAINS: Mapping[str, Chain] = {"free": identified_free, "inputs": identified_driven, "ambient": identified_ambient}
"""By kind of records."""


@takes_settings
def identify(
    records: Record | Sequence[Record],
    settings: Settings | None = None,
    *,
    report: Callable[[str], None] = lambda _: None,
    **options: Unpack[Options],
) -> Analysis:
    r"""Identify a linear time-periodic system from its response.

    .. math:: \dot z_r = \lambda_r z_r + \sum_l e^{i l \omega t} (b_{r,l}\, u + \kappa_{r,l}\, e), \qquad
              y = \sum_r \sum_m c_{r,m}\, e^{i m \omega t} z_r + \sum_n e^{i n \omega t} D_n u + e

    A free response has neither u nor κ: it is cut into periods, lifted (eqs. 7-10 of Allen 2009, as corrected), its
    poles are found by maximum likelihood with the order tested, shapes are expanded in harmonics (eqs. 4-12), and all
    is fitted to the samples. With `inputs` the way of what was measured to each mode is found, too. With
    `excitation="ambient"` that of the innovations e is: random excitation that nobody measured, beside inputs or alone.
    When `states` are named, A(t) is rebuilt (eqs. 13-21), with inputs B(t), too.

    A model that leaves many times the noise, or against which something was found, is returned, but it fails:
    `Analysis.failed`, its first warning, its verdict.

    Parameters
    ----------
    records
        One record, or several of the same system; of free responses one a hit.
    settings
        The options; or give them by name.
    report
        Is told what is being done, a phrase a stage.
    **options
        Fields of `Settings`, which come before those of `settings`.

    Returns
    -------
    Analysis
        The model with deviations, the verdict, and every intermediate.

    Raises
    ------
    InputError
        A record or an option is not possible.
    IdentificationError
        No mode rises above the noise, the record is too short, the inputs say nothing of the system, or the result
        would look right and be wrong.
    """
    chosen, left_out = settings_of(settings, options, OF), list[Finding]()
    while True:
        prepared = prepare(records, chosen, report=report)
        try:
            with own_names(OF), blas_threads(prepared.records):
                look_for_sums(prepared)
                found = _reported(CHAINS[prepared.settings.kind](prepared, report))
        except SumError as error:
            report(f"leaving {error.channel} out")
            records, chosen = without(error.channel, records, chosen)
            left_out.append(error.finding)
        except IdentificationError as error:
            said = texts((*left_out, *prepared.faults, *_angle_known(prepared)))
            raise IdentificationError("\n  ".join([str(error), *said])) from None
        else:
            return replace(found, findings=(*left_out, *prepared.faults, *found.findings))


def _angle_known(prepared: Prepared) -> tuple[Finding, ...]:
    """The note how well pulses that are known to a sample only tell the angle of a shaft, in the worst record."""
    pairs = zip(prepared.shafts, prepared.responses, strict=False)
    worst = max((shaft.angle_spread(record.times) for shaft, record in pairs if shaft.rounded), default=0.0)
    return (note("angle_known", degrees=np.degrees(worst), percent=100.0 * worst),) if worst else ()


def _reported(found: Analysis) -> Analysis:
    """The result on the branch asked for, with the operating point of its records; the clock's speed without one."""
    speed = 60.0 / (found.model.period * found.settings.periods_per_revolution)
    given = common_point(record.point for record in found.records)
    try:
        model = on_branch(found.model, found.settings.branch)
    except UnevenError as error:  # the modes are found, and stay on the branches of their strongest lines
        told = warning("branch_left", frequency=error.frequency, share=error.share)
        model, found = found.model, replace(found, findings=(*found.findings, told))
    else:
        found = _named(found, model)
        if found.settings.branch == "symmetric":  # over the middle of a symmetric structure a scan repeats twice
            kept = (own for own in found.findings if own.code != "period_multiple" or own.numbers["times"] != 2)
            found = replace(found, findings=(*kept, *_uneven(model)))
    model = replace(model, point={"speed_rpm": speed, **given})
    if found.decay is None:
        return replace(found, model=model)
    return replace(found, model=model, decay=replace(found.decay, fit=replace(found.decay.fit, model=model)))


def _uneven(model: PeriodicModel) -> tuple[Finding, ...]:
    """The finding on shapes that are no mirror images about a turning point, as those of a scan are."""
    if model.estimates is None:
        return (note("branch_untested"),)
    squares, degrees = unevenness(model)
    limit = chi2_limit(degrees, RARE) if degrees else 0.0
    return (warning("branch_uneven", squares=squares, limit=limit),) if squares > limit else ()


NAMED = {
    "product": ("frequency", "of"),
    "double": ("first", "second"),
    "one_that_moves": ("first", "second"),
    "harmonic_left": (),  # its harmonics count from the strongest line, and so does its frequency
}
"""Numbers of a finding that are frequencies of modes, by its code, beside `frequency` and `frequencies`."""


def _named(found: Analysis, model: PeriodicModel) -> Analysis:
    """The result with findings that name modes by the frequencies of a `model`, whose branches are others."""
    before, after = found.model.frequencies_hz, model.frequencies_hz

    def hertz(value: float) -> float:
        places = np.flatnonzero(np.abs(before - value) < HALF_DIGITS * value)  # rounding depends on who computed it
        return float(after[places[0]]) if len(places) else value

    def renamed(finding: Finding) -> Finding:
        numbers = dict(finding.numbers)
        for name in NAMED.get(finding.code, ("frequency", "frequencies")):
            if name in numbers:
                own = numbers[name]
                numbers[name] = tuple(map(hertz, own)) if isinstance(own, tuple) else hertz(own)
        return replace(finding, numbers=numbers)

    checked = found.validation
    if checked is not None:
        checked = replace(checked, findings=tuple(map(renamed, checked.findings)))
    return replace(found, findings=tuple(map(renamed, found.findings)), validation=checked)
