"""Checks of arguments, with messages of one grammar (see `floquid.errors`)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields
from functools import cache, wraps
from inspect import signature
from math import isfinite
from numbers import Integral, Real
from types import MappingProxyType
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from floquid._arrays import BLOCK
from floquid._show import Brief
from floquid.errors import InputError

Made = TypeVar("Made")

_LONGEST_NAME, _LONGEST_PART = 200, 4000


class Rebuilt(Brief):
    """A frozen dataclass that copies and pickles rebuild by its constructor: arrays stay read-only, checks hold."""

    __slots__ = ()

    def __reduce__(self) -> tuple[Any, ...]:
        """The constructor with the fields that it takes; of a read-only mapping a plain one, which can be pickled."""
        taken = {field.name: getattr(self, field.name) for field in fields(cast("Any", self)) if field.init}
        plain = {name: dict(value) if isinstance(value, MappingProxyType) else value for name, value in taken.items()}
        return _rebuilt, (type(self), plain)

    def _freeze(
        self, *, dtype: DTypeLike = np.float64, finite: bool = True, missing: bool = False, **axes: Sequence[str | int]
    ) -> None:
        """Make the fields named read-only arrays of these axes (`frozen_array`); one that may be None may stay so."""
        of, optional = type(self).__name__, optional_fields(type(self))
        for name, wanted in axes.items():
            value = getattr(self, name)
            if value is not None or name not in optional:
                checks: dict[str, Any] = {"dtype": dtype, "axes": wanted, "finite": finite, "missing": missing}
                object.__setattr__(self, name, frozen_array(cast("Any", value), name, of, **checks))


@cache
def optional_fields(kind: type) -> frozenset[str]:
    """The fields of a class that may be None."""
    return frozenset(field.name for field in fields(cast("Any", kind)) if "None" in str(field.type))


def _rebuilt(kind: type[Rebuilt], values: dict[str, Any]) -> Rebuilt:
    """An object of its fields as a pickle or a copy holds them: made for it alone, so no array need be copied again."""
    for value in values.values():
        _seal(value)
    return kind(**values)


def _seal(value: object) -> None:
    """Make an array read-only, and those in tuples and mappings."""
    if isinstance(value, np.ndarray):
        value.flags.writeable = False
    elif isinstance(value, (tuple, list)):
        for one in value:
            _seal(one)
    elif isinstance(value, dict):
        _seal(tuple(value.values()))


class Sealed(Rebuilt):
    """A result of ours: its arrays are right as they come, and are read-only in it."""

    __slots__ = ()

    def __post_init__(self) -> None:
        """Hold a read-only view of every array: that of the caller stays as it is."""
        for field in fields(cast("Any", self)):
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                value = value.view()
                value.flags.writeable = False
                object.__setattr__(self, field.name, value)


def answers_slips(example: str, slips: Mapping[str, str]) -> Callable[[type[Made]], type[Made]]:
    """A decorator of a class: a call whose arguments it does not have is answered with what to write.

    `example` is a call that is right; `slips` are names that one may try, each with what to write in its place.
    """

    def decorated(kind: type[Made]) -> type[Made]:
        made = kind.__init__
        known = list(signature(made).parameters.values())[1:]

        @wraps(made)
        def init(self: Made, *given: Any, **named: Any) -> None:
            try:
                made(self, *given, **named)
            except TypeError:
                strange = [name for name in named if name not in {one.name for one in known}]
                missing = [f"`{one.name}`" for one in known if one.default is one.empty and one.name not in named]
                if given:
                    wrong = "takes named arguments, no positional ones"
                elif strange:
                    wrong = f"has no argument `{strange[0]}`"
                elif missing:
                    wrong = f"needs {' and '.join(missing)}"
                else:
                    raise  # a mistake of another kind, inside
                own = slips.get(strange[0]) if strange and not given else None
                write = f"`{example}`" if own is None else f"`{own}`, as in `{example}`"
                raise TypeError(f"{kind.__name__} {wrong}: write {write}") from None

        kind.__init__ = init
        return kind

    return decorated


def input_error(argument: str, of: str, must: str, got: str, remedy: str = "") -> InputError:
    """The message «Argument `a` of `f` must …, but …», with the way out on a line of its own."""
    message = f"Argument `{argument}` of `{of}` must {_short(must)}, but {_short(got)}."
    return InputError(_plain(message + (f"\n  {_short(remedy)}" if remedy else "")))


def printable(text: str) -> str:
    """A name from a file, without what would act on a terminal and of a length that fits one."""
    return _plain(text.replace("\n", "?"))[:_LONGEST_NAME]


def _short(text: str) -> str:
    """A text, possibly with words from a file in it, cut in the middle where nobody would read on."""
    half = _LONGEST_PART // 2
    return text if len(text) <= _LONGEST_PART else f"{text[:half]} ... {text[-half:]}"


def _plain(text: str) -> str:
    """A text, possibly with words from a file in it, without what would act on a terminal."""
    if text.isprintable():
        return text
    return "".join(letter if letter.isprintable() or letter in "\n\u00a0" else "?" for letter in text)


def frozen_array(
    value: ArrayLike,
    argument: str,
    of: str,
    *,
    dtype: DTypeLike = np.float64,
    axes: Sequence[str | int],
    finite: bool = True,
    missing: bool = False,
    remedy: str = "",
) -> NDArray[Any]:
    """A read-only array of `dtype` with the named axes.

    A writable input is copied; a read-only one of the right type is taken as it is. An entry of `axes` that is an
    integer fixes that axis' length. `missing` lets NaN through (infinities never are). Nothing is rounded, and no
    mask or imaginary part is dropped.
    """
    if isinstance(value, np.ma.MaskedArray):
        way_out = "`.filled(np.nan)`" if missing else "the entries that count"
        raise input_error(argument, of, "be a plain array", "is a masked one", f"Pass {way_out}.")
    try:
        raw = np.asarray(value)
        if raw.dtype.kind not in "biufc":
            raise TypeError
        if raw.dtype.kind == "c" and np.dtype(dtype).kind != "c":
            raise input_error(argument, of, "be real", f"is complex ({raw.dtype})", "Pass its real part.")
        if raw.dtype.kind == "f" and np.dtype(dtype).kind == "i":
            broken = ~np.isfinite(raw) | (raw != np.floor(raw))
            if broken.any():
                raise input_error(argument, of, "hold integers", f"has {raw[broken][0]}", remedy)
        array = raw.astype(dtype, copy=False)
    except (TypeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        must = f"be an array of numbers of shape {_shape_words(axes)}"
        raise wrong_value(argument, of, must, value, remedy) from None
    if array.ndim != len(axes) or any(isinstance(a, int) and n != a for a, n in zip(axes, array.shape, strict=True)):
        raise input_error(argument, of, f"have shape {_shape_words(axes)}", f"has shape {array.shape}", remedy)
    if finite:
        bad = np.isinf(array) if missing else ~np.isfinite(array)
        if bad.any():
            where = tuple(int(i) for i in np.argwhere(bad)[0])
            words = "be finite (NaN alone marks a missing sample)" if missing else "be finite"
            got = f"has {int(bad.sum())} entries that are not, the first of them {array[where]} at index {where}"
            raise input_error(argument, of, words, got, remedy)
    if array.flags.writeable:
        array = array.copy() if np.shares_memory(array, raw) else array
        array.flags.writeable = False
    return array


def _shape_words(axes: Sequence[str | int]) -> str:
    return "(" + ", ".join(str(a) for a in axes) + ("," if len(axes) == 1 else "") + ")"


def noise_array(
    value: ArrayLike, of: str, axes: Sequence[str | int], remedy: str = "Give each channel its noise."
) -> NDArray[Any]:
    """The deviations of noise that the public callable `of` was given, positive, as a read-only array of these axes."""
    spread = frozen_array(value, "noise", of, axes=axes)
    if not (spread > 0.0).all():
        raise input_error("noise", of, "be positive", f"has {spread.min():g}", remedy)
    return spread


def timed_matrices(truth: object, of: str, n: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """The `truth` that the callable `of` was given: instants (times,) and a matrix at each (times, n, n)."""
    if not isinstance(truth, tuple) or len(truth) != 2:
        raise input_error("truth", of, "be a pair (times, system)", f"is a {type(truth).__name__}")
    times = frozen_array(truth[0], "truth[0]", of, axes=("times",))
    return times, frozen_array(truth[1], "truth[1]", of, axes=(len(times), n, n))


def several(given: Made | Iterable[Made], kind: type[Made]) -> tuple[Made, ...]:
    """One object of a `kind`, or as many as are `given`, as a tuple of them."""
    return (given,) if isinstance(given, kind) else tuple(cast("Iterable[Made]", given))


def counted(number: int | str, word: str) -> str:
    """A number of things: 1 record, 2 records."""
    return f"{number} {word}" + ("" if str(number) == "1" else "s")


def describe(value: object) -> str:
    """A short description of a wrong value for a message."""
    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype} of shape {value.shape}"
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def wrong_value(argument: str, of: str, must: str, value: object, remedy: str = "") -> InputError:
    """The error of an argument that is another `value` than it must be."""
    return input_error(argument, of, must, f"is {describe(value)}", remedy)


def an_instance(value: object, kind: type[Made], argument: str, of: str, remedy: str = "") -> Made:
    """`value`, which must be of a class."""
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIO" else "a"
        raise wrong_value(argument, of, f"be {article} {kind.__name__}", value, remedy)
    return value


LARGEST = float(np.finfo(float).max / BLOCK) ** 0.25
"""Bound on a channel's largest value, and on one over it: sums of fourth powers beyond leave floating point."""


def refuse_size(largest: float, name: str, argument: str, of: str) -> None:
    """Refuse a channel, named as in a message, whose largest value is of a size that cannot be computed with."""
    if largest > LARGEST or 0.0 < largest < 1.0 / LARGEST:
        must = f"have values whose squares can be computed with, between {1.0 / LARGEST:.1g} and {LARGEST:.1g}"
        remedy = "Give it in another unit, or leave it out with `channels=`."
        raise input_error(argument, of, must, f"{name} reaches {largest:.3g}", remedy)


def kind_of(thing: object) -> str:
    """The kind of a result by its class: "analysis", "survey", ...; empty of all else, whatever fields it has."""
    kind = getattr(type(thing), "kind", "")
    return kind if isinstance(kind, str) else ""


def positive(value: object, argument: str, of: str, *, unit: str = "", remedy: str = "") -> float:
    """`value` as a finite number above zero."""
    number = finite(value, argument, of, unit=unit, remedy=remedy)
    if number <= 0.0:
        raise input_error(argument, of, f"be positive{_in(unit)}", f"is {number:g}", remedy)
    return number


def finite(value: object, argument: str, of: str, *, unit: str = "", remedy: str = "") -> float:
    """`value` as a finite number."""
    number = np.nan
    scalar = isinstance(value, Real) or (
        isinstance(value, np.ndarray) and value.ndim == 0 and value.dtype.kind in "iuf"
    )
    if scalar and not isinstance(value, (bool, np.bool_)):
        with suppress(OverflowError):
            number = float(value)  # type: ignore[arg-type]
    if not isfinite(number):
        raise wrong_value(argument, of, f"be a finite number{_in(unit)}", value, remedy)
    return number


def integer(
    value: object, argument: str, of: str, *, at_least: int, at_most: int | None = None, remedy: str = ""
) -> int:
    """`value` as an integer of at least `at_least`, and of `at_most` where that is given."""
    if not isinstance(value, Integral) or isinstance(value, (bool, np.bool_)) or int(value) < at_least:
        raise wrong_value(argument, of, f"be an integer of at least {at_least}", value, remedy)
    if at_most is not None and int(value) > at_most:
        raise wrong_value(argument, of, f"be an integer of at most {at_most}", value, remedy)
    return int(value)


def index(value: object, argument: str, of: str, end: int) -> int:
    """`value` as an index below `end`."""
    if (number := integer(value, argument, of, at_least=0)) >= end:
        raise input_error(argument, of, f"be less than {end}", f"is {value}", "Counting starts at 0.")
    return number


def _in(unit: str) -> str:
    return f" [{unit}]" if unit else ""
