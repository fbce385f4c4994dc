"""Readers of mesh files by libraries, one after another until one of them finds elements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pvdf_fem.files import open_regular_file
from pvdf_fem.mesh.files.content import MeshContent, MeshFileError
from pvdf_fem.mesh.files.library_process import Library, LibraryError, read_by_library

_ADVICE = "write it again with the program that made it, or as MSH, UNV, VTU or Abaqus .inp"


@dataclass(frozen=True)
class LibraryReader:
    """A reader of one file format.

    Parameters
    ----------
    libraries : sequence of str
        Names of the libraries that read the format, the preferred one first.
    advice : str
        What to do with a file that none of them can read.
    """

    libraries: Sequence[Library]
    advice: str = _ADVICE

    def read(self, path: Path) -> MeshContent:
        """Read a mesh file.

        Parameters
        ----------
        path : Path
            The file.

        Returns
        -------
        MeshContent

        Raises
        ------
        MeshFileError
            If no library finds elements in the file.
        """
        failures = []
        for library in self.libraries:
            try:
                content = read_by_library(library, path)
            except LibraryError as error:
                failures.append(str(error))
                continue
            if content.has_elements:
                return content
            failures.append(f"{library} finds no surface elements in it")
        raise MeshFileError(f"{', and '.join(failures)}; {self.advice}")


#: First lines of MSH files of the versions 1, 2 and 4.
_MSH_BEGINNINGS = (b"$NO", b"$MeshFormat", b"$Comments")


@dataclass(frozen=True)
class MshReader:
    """A reader of gmsh's MSH files, which refuses other files with the same extension.

    gmsh executes an MSH file with an unknown first line as a script, which can run any command.
    """

    def read(self, path: Path) -> MeshContent:
        """Read a mesh file; see `LibraryReader.read`."""
        with open_regular_file(path, "a mesh file") as file:
            beginning = file.read(200)
        if beginning.startswith(_MSH_BEGINNINGS):
            advice = (
                "write it again (gmsh -2 -order 2 film.geo -o film.msh; Netgen:"
                ' mesh.Export("film.msh", "Gmsh2 Format"))'
            )
            return LibraryReader(["gmsh"], advice).read(path)
        first = beginning.split(b"\n")[0].decode("latin-1").strip()
        if first[:1].isdigit():
            advice = 'in FreeFEM, write savemesh(Th, "film.mesh")'
        elif first.startswith("("):
            advice = "this is a Fluent mesh: export it as gmsh2, UNV or Abaqus .inp"
        else:
            advice = "write it with gmsh: gmsh -2 -order 2 film.geo -o film.msh"
        raise MeshFileError(f"is not gmsh's format: it begins with {first[:40]!r}; {advice}")
