"""Files of named variables: NumPy archives, MATLAB files, HDF5."""

from floquid.readers.variables._formats import load_mat, load_npy, load_npz, save_mat, save_npz
from floquid.readers.variables._hdf5 import load_hdf5, refuse_packed, save_hdf5

__all__ = ["load_hdf5", "load_mat", "load_npy", "load_npz", "save_hdf5", "save_mat", "save_npz"]
