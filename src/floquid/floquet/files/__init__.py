"""A(t) from files: arrays by name, and linearisations of OpenFAST."""

from floquid.floquet.files._lin_file import LinFile, LinSignals, read_lin
from floquid.floquet.files._linearisation import AzimuthResolution, OpenFastLinearisation
from floquid.floquet.files._read_matrix import MatrixFile, read_matrix
from floquid.floquet.files._read_openfast import AzimuthRole, read_openfast
