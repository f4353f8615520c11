"""Periodic systems with inputs and outputs: responses, transfer functions, lifted forms."""

from floquid.floquet.control._discrete import DiscretePeriodicSystem, discretise
from floquid.floquet.control._harmonic_state_space import HarmonicTransfer, harmonic_transfer
from floquid.floquet.control._lifted import LiftedSystem, lift, realise
from floquid.floquet.control._system import PeriodicSystem, simulate
