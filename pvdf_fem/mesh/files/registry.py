"""The mesh file formats that are read, by extension; a new format is one line here."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from pvdf_fem.files import open_regular_file
from pvdf_fem.mesh.files.abaqus_deck.reader import AbaqusReader
from pvdf_fem.mesh.files.content import MeshContent, MeshFileError
from pvdf_fem.mesh.files.library_reader import LibraryReader, MshReader


class MeshReader(Protocol):
    """A reader of one mesh file format."""

    def read(self, path: Path) -> MeshContent:
        """Read a mesh file; raise `MeshFileError`, which says what to change, if it is unusable.

        Parameters
        ----------
        path : Path
            The file.

        Returns
        -------
        MeshContent
        """
        ...


_MED_ADVICE = (
    "write it as MED 4.0 (MEDCoupling: write40(...); Salome: version 4.0 in the dialog of the"
    " export), or as UNV"
)
_VTU_ADVICE = "in ParaView, save it as VTU with the compressor ZLib or none"
_MEDIT_ADVICE = (
    'give a Medit file of first order (FreeFEM: savemesh(Th, "film.mesh")), or write it as MSH'
    ' (Netgen: mesh.Export("film.msh", "Gmsh2 Format"))'
)

READERS: dict[str, MeshReader] = {
    ".msh": MshReader(),
    ".inp": AbaqusReader(),
    ".unv": LibraryReader(["gmsh"]),
    ".bdf": LibraryReader(["gmsh"]),
    ".nas": LibraryReader(["gmsh"]),
    ".med": LibraryReader(["gmsh", "meshio"], _MED_ADVICE),
    ".mesh": LibraryReader(["gmsh", "meshio"], _MEDIT_ADVICE),
    ".cgns": LibraryReader(["gmsh"]),
    ".stl": LibraryReader(["gmsh"]),
    # VTK's own legacy files cannot be read by gmsh, which reads only those that it has written
    ".vtk": LibraryReader(["meshio", "gmsh", "vtk"], _VTU_ADVICE),
    ".vtu": LibraryReader(["meshio", "vtk"], _VTU_ADVICE),
    ".pvtu": LibraryReader(["vtk"], _VTU_ADVICE),
    ".vtp": LibraryReader(["vtk"], _VTU_ADVICE),
    ".xdmf": LibraryReader(["meshio"]),
    ".xmf": LibraryReader(["meshio"]),
}

_GEOMETRY_ADVICE = "it is a geometry: mesh it with gmsh: gmsh -2 -order 2 {name} -o film.msh"
_NETGEN_ADVICE = 'in Netgen, export it: mesh.Export("film.msh", "Gmsh2 Format")'
#: What to do with files of other extensions.
_ADVICE = {
    ".vol": _NETGEN_ADVICE,
    ".geo": _GEOMETRY_ADVICE,
    ".geo_unrolled": _GEOMETRY_ADVICE,
    ".step": _GEOMETRY_ADVICE,
    ".stp": _GEOMETRY_ADVICE,
    ".brep": _GEOMETRY_ADVICE,
    ".iges": _GEOMETRY_ADVICE,
    ".igs": _GEOMETRY_ADVICE,
    ".e": 'write it as VTU: meshio convert {name} film.vtu (needs: pip install "meshio[all]")',
    ".exo": 'write it as VTU: meshio convert {name} film.vtu (needs: pip install "meshio[all]")',
    ".vtkhdf": "in ParaView, save it as VTU",
    ".pvd": "it only lists other files; give one of them",
    ".vtm": "it only lists other files; give one of them",
}


def read_content(path: Path) -> MeshContent:
    """Read the nodes and surface elements of a mesh file in the format of its extension.

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
        If the extension is unknown or the file has no elements.
    FileError
        If the file cannot be read.
    """
    with open_regular_file(path, "a mesh file"):
        pass  # check only: the readers open the file themselves
    extension = path.suffix.lower()
    if extension == ".gz":
        raise MeshFileError(f"is compressed; unpack it: gunzip {path.name}")
    reader = READERS.get(extension)
    if reader is None:
        formats = " ".join(READERS)
        advice = _ADVICE.get(extension, "write the mesh in one of them, best as .msh or .vtu")
        advice = advice.format(name=path.name)
        raise MeshFileError(f"has none of the supported extensions {formats}; {advice}")
    return reader.read(path)
