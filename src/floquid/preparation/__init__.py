"""From records and `Settings` to what is identified: `prepare`, for every kind of record.

The clock is put on, samples that are none are mended, channels that are no responses are left out, and what cannot end
well is refused before any long work. Of free responses hits are cut out; where the excitation goes on outputs and
inputs are parted (`parted`), with what repeats beside them. `propose` has the settings to try first with a record.
"""

from typing import TYPE_CHECKING

from floquid._show import named_late

if TYPE_CHECKING:
    from floquid.preparation._before import begun, from_sample
    from floquid.preparation._clocks import clocked, clocks_of, in_phase, states_of, with_events, without_clock
    from floquid.preparation._excited import FORBIDDEN, WORDS, parted, refuse_others
    from floquid.preparation._forces import refuse_excited
    from floquid.preparation._options import Options, Reading, RecordOptions, takes_settings
    from floquid.preparation._prepare import Prepared, blas_threads, prepare, uneven_speed
    from floquid.preparation._proposal import Candidate, Proposal, propose
    from floquid.preparation._refuse import NO_NEWS, name_of, own_names, refuse_few, refuse_sizes
    from floquid.preparation._settings import SHORT, Excitation, IdentifierName, Settings, for_command, settings_of

__all__ = ["Candidate", "Prepared", "Proposal", "Reading", "Settings", "prepare", "propose"]

__getattr__, __dir__ = named_late(
    __name__,
    _before="begun from_sample",
    _clocks="clocked clocks_of in_phase states_of with_events without_clock",
    _excited="FORBIDDEN WORDS parted refuse_others",
    _forces="refuse_excited",
    _options="Options Reading RecordOptions takes_settings",
    _prepare="Prepared blas_threads prepare uneven_speed",
    _proposal="Candidate Proposal propose",
    _refuse="NO_NEWS name_of own_names refuse_few refuse_sizes",
    _settings="SHORT Excitation IdentifierName Settings for_command settings_of",
)
