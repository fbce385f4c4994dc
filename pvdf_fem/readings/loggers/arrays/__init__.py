"""Files with named arrays: HDF5 and MATLAB."""
