"""From records and `Settings` to what is identified: `prepare`, for every kind of record.

The clock is put on, samples that are none are mended, channels that are no responses are left out, and what cannot end
well is refused before any long work. Of free responses hits are cut out; where the excitation goes on outputs and
inputs are parted (`parted`), with what repeats beside them. `propose` has the settings to try first with a record.
"""

from floquid.preparation._before import begun as begun
from floquid.preparation._before import from_sample as from_sample
from floquid.preparation._clocks import clocked as clocked
from floquid.preparation._clocks import clocks_of as clocks_of
from floquid.preparation._clocks import states_of as states_of
from floquid.preparation._clocks import without_clock as without_clock
from floquid.preparation._excited import FORBIDDEN as FORBIDDEN
from floquid.preparation._excited import WORDS as WORDS
from floquid.preparation._excited import parted as parted
from floquid.preparation._excited import refuse_others as refuse_others
from floquid.preparation._forces import refuse_excited as refuse_excited
from floquid.preparation._mended import MOST_ABSENT as MOST_ABSENT
from floquid.preparation._prepare import Prepared, prepare
from floquid.preparation._prepare import blas_threads as blas_threads
from floquid.preparation._prepare import uneven_speed as uneven_speed
from floquid.preparation._proposal import Candidate, Proposal, propose
from floquid.preparation._proposal import Use as Use
from floquid.preparation._reading import Reading
from floquid.preparation._refuse import NO_NEWS as NO_NEWS
from floquid.preparation._refuse import name_of as name_of
from floquid.preparation._refuse import own_names as own_names
from floquid.preparation._refuse import refuse_few as refuse_few
from floquid.preparation._settings import Excitation as Excitation
from floquid.preparation._settings import IdentifierName as IdentifierName
from floquid.preparation._settings import Options as Options
from floquid.preparation._settings import RecordOptions as RecordOptions
from floquid.preparation._settings import Settings
from floquid.preparation._settings import settings_of as settings_of
from floquid.preparation._settings import takes_settings as takes_settings

__all__ = ["Candidate", "Prepared", "Proposal", "Reading", "Settings", "prepare", "propose"]
