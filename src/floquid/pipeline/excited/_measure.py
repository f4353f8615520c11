"""Harmonic transfer functions measured line by line: the chain from records."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal, TypeAlias, Unpack, get_args

import numpy as np
from numpy.typing import ArrayLike

from floquid._checks import frozen_array, input_error, integer, positive, wrong_value
from floquid.core import Record, channels_named
from floquid.errors import IdentificationError
from floquid.pipeline._frequencies import POINTS
from floquid.preparation import (
    RecordOptions,
    Settings,
    begun,
    blas_threads,
    clocked,
    own_names,
    parted,
    refuse_others,
    refuse_sizes,
    settings_of,
)
from floquid.transfer import CURVATURE, MeasuredTransfer, by_chirps, by_polynomials, by_repeats, repeat_of

OF = "measure_transfer"

Method: TypeAlias = Literal["repeats", "polynomials", "chirps"]
"""Ways to measure G."""


def measure_transfer(
    records: Record | Sequence[Record],
    settings: Settings | None = None,
    *,
    method: Method | None = None,
    harmonics: ArrayLike = (-2, -1, 0, 1, 2),
    frequencies_hz: ArrayLike | None = None,
    repeat: int | None = None,
    drop: int = 1,
    reference: Sequence[str] = (),
    curvature: float = CURVATURE,
    report: Callable[[str], None] = lambda _: None,
    **options: Unpack[RecordOptions],
) -> MeasuredTransfer:
    r"""Measure harmonic transfer functions line by line, without a model.

    .. math:: u(t) = e^{i \Omega t} \;\to\; y(t) = \sum_m G_m(\Omega)\, e^{i (\Omega + m \omega) t}

    of samples: what the input does between them, and what is folded, are in G. Where the inputs repeat after a whole
    number of periods, as those of `multisine`, G is that of their lines. Its variance is that of the repeats; otherwise
    it is found by polynomials over neighbouring lines (local polynomial method). Chirps, one a record, from rest and
    back to it, begin at different phases of the period. From them G is found at all lines at once, its curvature
    penalised (Siddiqi 2001, `transfer.by_chirps`). A scan, one sine after another, is several records of repeats.

    Parameters
    ----------
    records
        One record, or several of the same channels, inputs among them, at a constant period.
    settings
        The options, with `inputs`; or give them by name.
    method
        "repeats", "polynomials" or "chirps"; by default repeats where the inputs repeat, polynomials where not.
    harmonics
        The integers m (harmonics,).
    frequencies_hz
        Ω/2π (frequencies,) [Hz], the nearest lines; by default 400 over what the inputs excite. Of inputs that repeat
        all their lines are taken, and these do not count.
    repeat
        Periods of the system in a repeat of the inputs; by default found from them.
    drop
        Repeats at the start of each record that are left out, for the transient to die.
    reference
        Names of channels, as many as inputs, that drive the inputs and know nothing of the noise, as the command of a
        loop: G is then free of bias where there is a feedback or noise on the inputs. By polynomials alone.
    curvature
        The weight α of the curvature, of chirps alone: more of it averages more noise, and flattens more.
    report
        Is told what is being done, a phrase a stage.
    **options
        Fields of `Settings`: `period`, `channels`, `inputs`.

    Returns
    -------
    MeasuredTransfer
        G with deviations, coherence, noise, and the level of what is not linear; of chirps G alone.

    Raises
    ------
    InputError
        The records, the inputs or the clock are not possible.
    IdentificationError
        The records are too short, the inputs say nothing, or their lines meet in the response.
    """
    chosen = settings_of(settings, options, OF)
    if not chosen.inputs:
        remedy = 'Name the channels that drive the system: `inputs=["force"]`.'
        raise input_error("inputs", OF, "name a channel", "is empty", remedy)
    refuse_others(chosen, OF)
    if chosen.excitation != "none":
        remedy = "What nobody measured is noise here: repeats and lines average it."
        raise wrong_value("excitation", OF, 'be "none"', chosen.excitation, remedy)
    _refuse_options(method, repeat, drop, curvature)
    _refuse_references(reference, chosen, method)
    turns = frozen_array(np.atleast_1d(harmonics), "harmonics", OF, axes=("harmonics",), dtype=np.int64).tolist()
    with own_names(OF):
        beside = replace(chosen, inputs=(*chosen.inputs, *reference), forced="none")
        for record in clocked(records, replace(beside, channels=()), OF):
            channels_named(record.channels, reference, argument="reference", of=OF)
        used = clocked(records, beside, OF)
        refuse_sizes(used, OF)
        used, said = begun(used, beside)
        report("parting inputs and outputs")
        # What repeats with the period stands at lines of its own, which are left out.
        own = parted(used, beside, OF)
        if own.shafts:
            remedy = "Lines are sharp at constant speed alone: use `identify`, which follows the angle."
            raise input_error("records", OF, "have a constant period", "have a measured clock", remedy)
        missing = own.samples.n_samples - own.samples.count
        if missing:
            remedy = "Lines are sums over every sample: cut the record at the gap, or `identify`."
            raise input_error("records", OF, "miss no sample", f"miss {missing}", remedy)
        count = len(chosen.inputs)
        held = own.samples.inputs[count:] if reference else None
        samples, channels = replace(own.samples, inputs=own.samples.inputs[:count]), (own.outputs, own.inputs[:count])
        with blas_threads(used):
            hertz = POINTS if frequencies_hz is None else np.atleast_1d(np.asarray(frequencies_hz, float))
            by_lines = method in ("polynomials", "chirps") or reference
            periods = None if by_lines else repeat or repeat_of(samples)
            if method == "repeats" and periods is None:
                raise IdentificationError(
                    "The inputs do not repeat after a whole number of periods, three times at least. Name that number "
                    "(`repeat`), correct the period, or let polynomials over lines part them (`method`)."
                )
            if method == "chirps":
                report("fitting chirps")
                found = by_chirps(samples, turns, channels, hertz, curvature)
            elif periods is not None:
                report("averaging repeats")
                found = by_repeats(samples, periods, turns, channels, drop)
            else:
                report("fitting polynomials over lines")
                found = by_polynomials(samples, turns, channels, hertz, held)
        return replace(found, findings=(*said, *own.findings, *found.findings))


def _refuse_options(method: Method | None, repeat: int | None, drop: int, curvature: float) -> None:
    """Refuse options that are not possible, or of another method."""
    if method not in (None, *get_args(Method)):
        raise wrong_value("method", OF, f"be one of {get_args(Method)}", method, "Or leave it out.")
    if repeat is not None:
        integer(repeat, "repeat", OF, at_least=2, remedy="Periods of one repeat; leave it out, and it is found.")
    if repeat is not None and method not in (None, "repeats"):
        must, got = f"be left out with method={method!r}", f"is {repeat}"
        raise input_error("repeat", OF, must, got, 'It counts for method="repeats" alone.')
    integer(drop, "drop", OF, at_least=0, remedy="As drop=1.")
    positive(curvature, "curvature", OF, remedy=f"As curvature={CURVATURE}.")
    if curvature != CURVATURE and method != "chirps":
        must, got = "be left out but of chirps", f"is {curvature!r} with method={method!r}"
        raise input_error("curvature", OF, must, got, 'It counts for method="chirps" alone.')


def _refuse_references(reference: Sequence[str], settings: Settings, method: Method | None) -> None:
    """Refuse references that cannot stand for the inputs."""
    if not reference:
        return
    if isinstance(reference, str) or len(reference) != len(settings.inputs) or {*reference} & {*settings.inputs}:
        must = f"name {len(settings.inputs)} channels other than the inputs, one for each"
        raise wrong_value("reference", OF, must, reference, 'As reference=["command"].')
    if method not in (None, "polynomials"):
        raise wrong_value("method", OF, "be left out with `reference`", method, "It is by polynomials.")
