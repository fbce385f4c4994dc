"""What a build of a response has solved so far, kept in a directory until the response is saved."""

from __future__ import annotations

import hashlib
import shutil
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.files import FileError, make_directory, replacing, require_writable
from pvdf_fem.sweeps.store import Store


@dataclass(frozen=True)
class Unfinished:
    """The directory ``FILE.part`` beside a response's file; without one nothing is kept."""

    folder: Path | None

    @classmethod
    def beside(cls, file: Path | None) -> Unfinished:
        """The directory of a response's file; `FileError` where one of them cannot be made."""
        if file is None:
            return cls(None)
        require_writable(file)
        folder = file.with_name(f"{file.name}.part")
        make_directory(folder, "x")
        return cls(folder)

    def store(self) -> AbstractContextManager[Store | None]:
        """The store of the touches that are held out."""
        return nullcontext() if self.folder is None else Store(self.folder / "touches.db")

    def field(self, text: str) -> Array | None:
        """The field of what a text describes, if it was solved."""
        with suppress(OSError, ValueError, EOFError):
            return None if self.folder is None else np.load(self._path(text), allow_pickle=False)
        return None

    def put(self, text: str, field: Array) -> None:
        """Keep a field."""
        if self.folder is not None:
            # the directory is away when another program has just completed the same response
            with suppress(FileError), replacing(self._path(text)) as temporary:
                np.save(temporary, field)

    def remove(self) -> None:
        """Remove the directory."""
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)

    def _path(self, text: str) -> Path:
        assert self.folder is not None
        return self.folder / f"{hashlib.sha256(text.encode()).hexdigest()[:32]}.npy"
