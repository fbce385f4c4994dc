"""HDF5 files, including MATLAB files of version 7.3 and NetCDF-4 files."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Any

from pvdf_fem.readings.loggers.arrays.named_arrays import NamedArray, NamedArrayReader

#: The signature of HDF5, which stands at the beginning or after a block of 512, 1024, ... bytes.
SIGNATURE = b"\x89HDF\r\n\x1a\n"
#: Attribute of each array of a MATLAB file. MATLAB counts indices in the reverse order.
MATLAB_ATTRIBUTE = "MATLAB_class"


class Hdf5Reader(NamedArrayReader):
    """A reader of HDF5 by h5py. Attributes of groups and arrays may have their rate and unit."""

    title = "HDF5"
    extensions = (".h5", ".hdf5", ".hdf", ".he5", ".nc")
    package = "h5py"

    def __init__(self, path: Path, stack: ExitStack) -> None:
        super().__init__(path, stack)
        self.h5py = self.import_package("h5py")
        try:
            file = stack.enter_context(self.h5py.File(path, "r"))
        except OSError as error:
            raise self.make_format_error(error) from None
        arrays: list[NamedArray] = []
        self._add_attributes("", file)
        file.visititems(lambda name, item: self._collect(name, item, arrays))
        self.add_arrays(arrays)

    @classmethod
    def is_recognised(cls, head: bytes) -> bool:
        """Return whether a file has the signature of HDF5 at one of its possible positions."""
        return any(head[place : place + 8] == SIGNATURE for place in (0, 512, 1024, 2048))

    def _collect(self, name: str, item: Any, arrays: list[NamedArray]) -> None:
        """Append an item of the file to a list if it is an array, and set the intervals it gives.

        Parameters
        ----------
        name : str
            Address of the item.
        item : h5py.Group or h5py.Dataset
            The item: a group, an array, or a single number, which may be a rate.
        arrays : list of NamedArray
            The list of arrays.
        """
        self._add_attributes(name, item)
        if not isinstance(item, self.h5py.Dataset):
            return
        if item.shape == () and item.dtype.kind in "iuf":
            group, _, own_name = name.rpartition("/")
            self.set_interval(group, own_name, float(item[()]))
        # MATLAB keeps the parts of cells in a group of this name.
        if item.shape and not name.startswith("#refs#"):
            attributes = dict(item.attrs)
            is_transposed = MATLAB_ATTRIBUTE in attributes
            arrays.append(NamedArray(name, item, is_transposed, attributes))

    def _add_attributes(self, address: str, item: Any) -> None:
        """Set the sampling interval of a group or an array if one of its attributes gives it."""
        for name, value in item.attrs.items():
            if getattr(value, "shape", None) in ((), (1,)) and value.dtype.kind in "iuf":
                self.set_interval(address, name, float(value.ravel()[0]))
