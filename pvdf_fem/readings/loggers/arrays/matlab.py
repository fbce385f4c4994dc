"""MATLAB files of version 7 and older; those of version 7.3 are HDF5."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from pvdf_fem.readings.loggers.arrays.named_arrays import NamedArray, NamedArrayReader


class MatlabReader(NamedArrayReader):
    """A reader of MATLAB files by scipy, which loads them whole. Fields of structs are channels."""

    title = "MATLAB"
    extensions = (".mat",)
    package = "scipy"

    def __init__(self, path: Path, stack: ExitStack) -> None:
        super().__init__(path, stack)
        scipy_io = self.import_package("scipy.io")
        try:
            variables = scipy_io.loadmat(path, squeeze_me=True, struct_as_record=False)
        except (ValueError, TypeError, OSError, NotImplementedError) as error:
            raise self.make_format_error(error) from None
        arrays: list[NamedArray] = []
        for name, value in variables.items():
            if not name.startswith("__"):
                _collect(name, value, arrays)
        self.add_arrays(arrays)

    @classmethod
    def is_recognised(cls, head: bytes) -> bool:
        """Return whether a file has the header of MATLAB 5 to 7."""
        return head.startswith(b"MATLAB 5.0 MAT-file")


def _collect(address: str, value: Any, arrays: list[NamedArray]) -> None:
    """Append a numeric array, or those in the fields of a struct, to a list.

    Parameters
    ----------
    address : str
        Address of the variable or field.
    value : object
        Its value, as scipy returns it.
    arrays : list of NamedArray
        The list of arrays.
    """
    fields = getattr(value, "_fieldnames", None)
    if fields is not None:
        for field in fields:
            _collect(f"{address}/{field}", getattr(value, field), arrays)
        return
    samples = np.asarray(value)
    if samples.dtype.kind in "iuf":
        arrays.append(NamedArray(address, np.atleast_1d(samples), False, {}))
