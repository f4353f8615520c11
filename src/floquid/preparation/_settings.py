"""Every option of the chain."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np

from floquid._checks import answers_slips, finite, input_error, integer, positive, wrong_value
from floquid._show import Brief
from floquid.core import MOST_TIMES, AzimuthSignal, Branch, Form, Hold
from floquid.errors import InputError
from floquid.search import SECONDS

if TYPE_CHECKING:
    from floquid.lti import AbstractIdentifier

ALL = "all"  # name of all channels as states, each state a weighted sum of them
Excitation: TypeAlias = Literal["none", "ambient"]  # that goes on and that nobody measured

IdentifierName = Literal["ml", "ami", "era", "lscf", "poly", "ami-ml", "era-ml", "lscf-ml", "poly-ml"]
"""Words for the algorithms; those that end in -ml are finished by maximum likelihood."""


def _identifier_named(word: str, alarm: float) -> AbstractIdentifier:
    """The algorithm of a word of `IdentifierName`; `alarm` is the probability at which noise may pass for a mode."""
    from floquid.lti import AMI, ERA, LSCF, MaximumLikelihood, PolyLSCF

    first, _, last = word.partition("-")
    found: AbstractIdentifier = {
        "ml": MaximumLikelihood(false_alarm=alarm),
        "ami": AMI(false_alarm=alarm),
        "era": ERA(),
        "lscf": LSCF(),
        "poly": PolyLSCF(),
    }[first]
    return MaximumLikelihood(false_alarm=alarm, initial=found) if last else found


_PERIOD = {"T": "period=T", "freq": "period=1/freq", "frequency": "period=1/frequency", "rpm": "period=60/rpm"}
SLIPS = {**_PERIOD, "n_modes": "order=2*n_modes", "tachometer": 'tach="tach"', "method": "identifier=AMI()"}
"""Names that one may try for a field, and what to write."""


@answers_slips('Settings(period=6.28, states=["x", "y"])', SLIPS)
@dataclass(frozen=True, slots=True, kw_only=True)
class Settings(Brief):
    """Every option of `identify`.

    Raises InputError where a value is not possible.

    Parameters
    ----------
    period
        The period of the system [s]; that of each record's clock if not given. Seen from the ground, half a revolution
        of a two-fold symmetric shaft.
    channels
        Names of the channels to use; all if not given.
    inputs
        Names of the channels that drive the system, whose gains to each mode are identified.
    hold
        The input between samples: zero is constant (a D/A converter), first straight lines (a measured force), none
        impulses. The modes are the same; transfer functions differ.
    excitation
        Unmeasured excitation that goes on: none, or ambient, which is random.
    order
        The number of complex poles, conjugates counted one by one; found from the data if not given.
    harmonics
        Keep the harmonics from minus to plus this of each mode; those above the noise if not given.
    states
        Channels that are the displacement states of A(t), as `reconstruct` takes them; no A(t) if not given. "x+vx" for
        several channels of one motion, "0.5*x+y" for a sum with constant weights, ("all",) for sums of all channels.
    form
        The states that A(t) is in: second-order, first-order or delayed. "second-order": displacements and their
        velocities. "first-order": as many channels as modes, as they are. "delayed": channels and the same channels
        later, where they are too few to span the states.
    delay
        The delay [s] of delayed states; the one with the best condition if not given.
    structure
        The form of A(t), such as "stiffness 2 symmetric; damping 0", or "auto"; free if not given. An
        `AbstractStructure` or its text (`structure_of`), kept as text. "auto" is the simplest second-order form that
        fits, with deviations that count what wider ones could hide.
    output_error
        Fit the structured A(t) once more, to the record linearised anew at its exponents.
    system_times
        The number of instants of a period at which A(t) is given, 10,000 at most.
    identifier
        The algorithm that finds the poles; maximum likelihood if not given. An object of `floquid.lti`, or its word on
        the command line ("poly-ml"), at `mode_false_alarm`.
    mode_false_alarm
        The probability at which noise may pass for a mode. The `identifier` given has its own.
    harmonic_false_alarm
        The probability that noise passes for a harmonic anywhere. Over all harmonics of all modes together.
    seconds
        The processor time after which a search for modes ends with the best so far, and a warning [s]. Where poles were
        still being found the model fails. It bounds the search of an `identifier` that is passed, too.
    noise_floor
        The least noise, as a share of a channel's largest value. Raise it to the level down to which the record is
        right.
    constrained
        Finish with residues constrained to their harmonics, which also separates modes that fold onto one another.
    trust_period
        Warn instead of refusing where the response seems to repeat with another period than the one given.
    estimate_period
        Find the period from the response alone, within a factor of 1.5 of a period given too.
    tach
        The name of a channel of tachometer pulses.
    azimuth
        The name of a channel that holds the angle of the shaft, in degrees or radians.
    events
        The name of a channel of pulses, each the beginning of a period whatever its duration. On the command line also
        a table of their times.
    pulses_per_revolution
        Pulses of the tachometer in a revolution.
    periods_per_revolution
        Periods of the system in a revolution of the shaft. 2 for a two-fold symmetric shaft seen from the ground, whose
        imbalance has lines at half the period's frequency: they are fitted beside the modes.
    forced
        The forced response: auto finds it, none leaves it out, 1,2 are harmonics of the revolution to be fitted.
    orbit
        Subtract the periodic orbit that a record holds.
    find_hits
        Look for impacts in each record, and take each free response after one as a hit of its own.
    skip
        Periods left out after each impact, or at the start of each record, where the response is not linear yet. None
        leaves out first periods of free responses where that explains more.
    repair
        Leave out clipped samples, spikes and channels that stand still, and cut a record where it was hit again.
    branch
        The rule for the branch λ + ikω of each mode: strongest has its strongest line as harmonic 0, slowest the least
        |Im λ|, symmetric a shape that is even about a turning point of a scan.
    validate
        Check the model on cycles left out, on the residual, and on A(t) integrated.
    """

    period: float | None = None
    channels: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    hold: Hold = "zero"
    excitation: Excitation = "none"
    order: int | None = None
    harmonics: int | None = None
    states: tuple[str, ...] = ()
    form: str = "second-order"
    delay: float | None = None
    structure: str = ""
    output_error: bool = False
    system_times: int = 50
    identifier: AbstractIdentifier | None = None
    mode_false_alarm: float = 1e-9
    harmonic_false_alarm: float = 1e-6
    seconds: float = SECONDS
    noise_floor: float = 1e-10
    constrained: bool = True
    trust_period: bool = False
    estimate_period: bool = False
    tach: str | None = None
    azimuth: str | None = None
    events: str | None = None
    pulses_per_revolution: int = 1
    periods_per_revolution: float = 1.0
    forced: str = "auto"
    orbit: bool = True
    find_hits: bool = False
    skip: float | None = None
    repair: bool = True
    branch: Branch = "strongest"
    validate: bool = True

    def __post_init__(self) -> None:
        of = "Settings"
        if self.period is not None:
            object.__setattr__(self, "period", positive(self.period, "period", of, unit="s"))
        for name in ("channels", "inputs", "states"):
            value = getattr(self, name)
            listed = isinstance(value, (tuple, list))
            if not listed or not all(isinstance(entry, str) for entry in value):
                raise wrong_value(name, of, "be a list of channel names", value, 'Pass e.g. ["x", "y"].')
            object.__setattr__(self, name, tuple(value))
        if self.order is not None:
            integer(self.order, "order", of, at_least=1)
        if self.harmonics is not None:
            integer(self.harmonics, "harmonics", of, at_least=0)
        fewer = "Ask for fewer instants."
        integer(self.system_times, "system_times", of, at_least=1, at_most=MOST_TIMES, remedy=fewer)
        self._check_words()
        self._check_form()
        self._check_clock()
        object.__setattr__(self, "forced", _forced_text(self.forced))
        if self.skip is not None and finite(self.skip, "skip", of) < 0.0:
            raise input_error("skip", of, "not be negative", f"is {self.skip:g}", "It counts periods.")
        for name in ("constrained", "trust_period", "estimate_period", "orbit", "find_hits", "repair", "validate"):
            self._check_flag(name)
        object.__setattr__(self, "seconds", positive(self.seconds, "seconds", of, unit="s"))
        for name in ("mode_false_alarm", "harmonic_false_alarm", "noise_floor"):
            if not 0.0 < positive(getattr(self, name), name, of) < 1.0:
                raise input_error(name, of, "lie between 0 and 1", f"is {getattr(self, name)}")
        if self.identifier is not None:
            self._check_identifier()

    def _check_identifier(self) -> None:
        """Make an algorithm of its word, and refuse what is none."""
        from floquid.lti import AbstractIdentifier

        if isinstance(self.identifier, str) and self.identifier in get_args(IdentifierName):
            object.__setattr__(self, "identifier", _identifier_named(self.identifier, self.mode_false_alarm))
        if not isinstance(self.identifier, AbstractIdentifier):
            must = f"be one of {', '.join(get_args(IdentifierName))}, an object of `floquid.lti`, or None"
            raise wrong_value("identifier", "Settings", must, self.identifier, "Pass a word, or AMI(), say.")

    def _check_flag(self, name: str) -> None:
        value = getattr(self, name)
        if not isinstance(value, (bool, np.bool_)):
            raise wrong_value(name, "Settings", "be true or false", value)
        object.__setattr__(self, name, bool(value))

    def _check_words(self) -> None:
        """Refuse a word that is none of those that there are."""
        for name, words in (("hold", Hold), ("excitation", Excitation), ("branch", Branch)):
            if getattr(self, name) not in get_args(words):
                must = "be one of " + ", ".join(f'"{one}"' for one in get_args(words))
                raise wrong_value(name, "Settings", must, getattr(self, name))

    def _check_form(self) -> None:
        """Refuse a form, a delay and a structure that do not go together."""
        of = "Settings"
        if self.form not in get_args(Form):
            words = ", ".join(f'"{one}"' for one in get_args(Form))
            raise wrong_value("form", of, f"be one of {words}", self.form)
        if self.delay is not None:
            object.__setattr__(self, "delay", positive(self.delay, "delay", of, unit="s"))
            if self.form != "delayed":
                got = f'is {self.delay:g} with the form "{self.form}"'
                raise input_error("delay", of, 'be None unless the form is "delayed"', got, 'Pass form="delayed".')
        self._check_flag("output_error")
        if not isinstance(self.structure, str) or self.structure.strip():
            self._check_structure()
        elif self.output_error:
            remedy = 'Pass `structure="auto"` beside it.'
            raise input_error("output_error", of, "come with a structure", "there is none", remedy)
        else:
            object.__setattr__(self, "structure", "")

    def _check_structure(self) -> None:
        """Make a text of a structure, and refuse one that does not go together with form and states."""
        from floquid.reconstruction import AbstractStructure, FirstOrder, structure_of, text_of

        of, structure = "Settings", self.structure
        if isinstance(structure, AbstractStructure):
            structure = text_of(structure)
        if not isinstance(structure, str):
            must = 'be a structure, its text or "auto"'
            raise wrong_value("structure", of, must, structure, 'Pass e.g. "stiffness 2 symmetric; damping 0".')
        try:
            meant = structure_of(structure)
        except InputError as error:
            subject, _, words = str(error).partition(" must ")
            inner, where = subject.split("`")[1:4:2], {"structure_of": "", "Block": " in a block"}
            words = f"{where.get(inner[1], f' in its {inner[0]} block')} {words}"
            raise InputError(f"Argument `structure` of `{of}` must{words}") from error
        object.__setattr__(self, "structure", text_of(meant))
        form = "first-order" if isinstance(meant, FirstOrder) else "second-order"
        if self.form != form:
            must, got = f'come with the form "{form}"', f'is "{self.structure}" with the form "{self.form}"'
            raise input_error("structure", of, must, got, f'Pass `form="{form}"`.')
        if not self.states:
            got = f'is "{self.structure}" without any'
            raise input_error("structure", of, "come with states", got, "Name the channels that are the `states`.")
        if not self.constrained:
            must, got = "come with `constrained=True`", "is given with `constrained=False`"
            raise input_error("structure", of, must, got, "Leave `constrained` as it is: it gives what is fitted to.")

    def _check_clock(self) -> None:
        """Refuse two clocks at once, and numbers that no clock can have."""
        of = "Settings"
        integer(self.pulses_per_revolution, "pulses_per_revolution", of, at_least=1)
        try:
            AzimuthSignal(channel="-", periods_per_revolution=self.periods_per_revolution)
        except InputError as error:
            raise InputError(str(error).replace("AzimuthSignal", of)) from error
        given = {
            "period": self.period is not None,
            "tach": self.tach is not None,
            "azimuth": self.azimuth is not None,
            "events": self.events is not None,
            "estimate_period": bool(self.estimate_period),
        }
        named = [name for name, there in given.items() if there]
        for name in ("tach", "azimuth", "events"):
            value = getattr(self, name)
            if value is not None and (not isinstance(value, str) or not value.strip()):
                raise wrong_value(name, of, "be the name of a channel", value)
        if len(named) > 1 and named != ["period", "estimate_period"]:
            must, got = "not be given beside another clock", f"{' and '.join(named)} are"
            raise input_error(named[1], of, must, got, "Say in one way what ties the record to the period.")

    @property
    def all_found(self) -> bool:
        """True where order and harmonics are found, and no algorithm is chosen."""
        return self.order is None and self.identifier is None and self.harmonics is None

    @property
    def kind(self) -> Literal["free", "inputs", "ambient"]:
        """The kind of records: free responses, measured inputs, or excitation that nobody measured."""
        if self.excitation == "ambient":
            return "ambient"
        return "inputs" if self.inputs else "free"

    @property
    def forced_harmonics(self) -> str | tuple[int, ...]:
        """`forced` as `floquid.periodic.fit` takes it: "auto", "none", or harmonics of the revolution."""
        if self.forced in ("auto", "none"):
            return self.forced
        return tuple(int(word) for word in self.forced.split(","))


EXAMPLE = 'Record(values=y, sample_rate=fs, channels=["x", "y"])'
"""Call that makes a record of an array (channels, samples), for messages."""


def settings_of(settings: Settings | None, options: Mapping[str, Any], of: str) -> Settings:
    """The settings with the options given by name put over them."""
    known = [field.name for field in fields(Settings)]
    for name in options:
        if name not in known:
            near = [f"`{word}`" for word in get_close_matches(name, known, n=2)]
            meant = f"`{SLIPS[name]}`" if name in SLIPS else " or ".join(near)
            remedy = f"Did you mean {meant}?" if meant else f"Its options are: {', '.join(known)}."
            raise InputError(f"`{of}` has no option `{name}`. {remedy}")
    if not isinstance(settings, Settings | None):
        must = "be Settings, or options by name"
        raise wrong_value("settings", of, must, settings, f"Write `{of}({EXAMPLE}, period=T)`.")
    return replace(settings or Settings(), **options)  # type: ignore[arg-type]


def _forced_text(value: object) -> str:
    """The forced response asked for, as a text."""
    words = value.split(",") if isinstance(value, str) else value
    if isinstance(value, str) and value.strip() in ("auto", "none"):
        return value.strip()
    try:
        numbers = sorted({int(word) for word in words})  # type: ignore[union-attr]
        if not numbers or numbers[0] < 1 or any(float(word) != int(word) for word in words):  # type: ignore[union-attr]
            raise ValueError
    except (TypeError, ValueError):
        must = 'be "auto", "none" or harmonics of the revolution'
        raise wrong_value("forced", "Settings", must, value, 'Pass e.g. "1,2".') from None
    return ",".join(str(number) for number in numbers)


SHORT = {"pulses_per_revolution": "pulses_per_rev", "periods_per_revolution": "periods_per_rev"}
"""Settings that have shorter names on the command line."""

_KNOWN = {*(field.name for field in fields(Settings)), "rate", "origin", "header", "method", "repeat", "drop"}


def for_command(text: str) -> str:
    """The text with options as the command has them: `skip=` or (`skip`) is `--skip`, `order=4` is `--order 4`."""
    return re.sub(r"`(\w+)=([^`]*)`|(?<=\()`(\w+)`(?=\))", _flag, text)


def _flag(match: re.Match[str]) -> str:
    name, value = match[1] or match[3], (match[2] or "").strip("\"'")
    if name not in _KNOWN:
        return match[0]
    flag = SHORT.get(name, name).replace("_", "-")
    if value == "False":
        return f"`--no-{flag}`"
    return f"`--{flag}`" if value in ("", "True") else f"`--{flag} {value}`"
