"""Read mesh files with gmsh, meshio and VTK, each in a process of its own.

Damaged files crash gmsh's UNV reader and can crash VTK's readers; meshio ends the interpreter for
some files, and gmsh has a single state per process, which may be in use. In a process of its own
none of this affects the program, and the libraries' messages are not printed.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import numpy as np

from pvdf_fem.files import escape_unprintable
from pvdf_fem.mesh.files.content import MeshContent
from pvdf_fem.mesh.gmsh_libraries import find_missing_packages

Library = Literal["gmsh", "meshio", "vtk"]

# A mesh of a million elements takes half a minute.
_MAX_SECONDS = 300.0
_MAX_REASON = 300  #: Maximum number of characters of a library's own message.
#: What to install for a missing module.
_INSTALL = {
    "vtk": 'run: pip install "pvdf-fem[view]"',
    "vtkmodules": 'run: pip install "pvdf-fem[view]"',
    "h5py": "run: pip install h5py",
}


class LibraryError(Exception):
    """A library cannot read a mesh file; the message is a clause with the library's name."""


def read_by_library(library: Library, path: Path) -> MeshContent:
    """Read a mesh file with a library in a process of its own.

    Parameters
    ----------
    library : {"gmsh", "meshio", "vtk"}
        The library.
    path : Path
        The file.

    Returns
    -------
    MeshContent

    Raises
    ------
    LibraryError
        If the library is not installed, cannot read the file, crashes, or takes too long.
    """
    script = Path(__file__).with_name("library_script.py")
    with TemporaryDirectory(prefix="pvdf-fem-") as folder:
        source = path.absolute()
        if library == "gmsh":
            # gmsh executes FILE.opt beside FILE as a script, and any file whose extension it does
            # not know, also in capital letters
            source = Path(folder, f"film{path.suffix.lower()}")
            shutil.copyfile(path, source)
        result = Path(folder, "mesh.npz")
        # -P: a file such as gmsh.py in the current directory must not be imported
        command = [sys.executable, "-P", str(script), library, str(source), str(result)]
        try:
            run = subprocess.run(
                command, capture_output=True, stdin=subprocess.DEVNULL, timeout=_MAX_SECONDS
            )
        except subprocess.TimeoutExpired:
            raise LibraryError(f"{library} did not end within {_MAX_SECONDS:g} s") from None
        if run.returncode != 0:
            output = run.stdout.replace(str(source).encode(), path.name.encode())
            raise LibraryError(_describe_failure(library, run.returncode, output=output))
        return _load_content(result)


def _load_content(result: Path) -> MeshContent:
    """Load the file that `library_script` wrote."""
    with np.load(result, allow_pickle=False) as arrays:
        counts = arrays["other_counts"].tolist()
        return MeshContent(
            points=arrays["points"],
            triangles=arrays["triangles"],
            triangles6=arrays["triangles6"],
            others=dict(zip(arrays["other_names"].tolist(), counts, strict=True)),
        )


def _describe_failure(library: Library, code: int, output: bytes) -> str:
    """Describe why a library could not read a file, in a clause.

    Parameters
    ----------
    library : str
        The library.
    code : int
        Exit code of `library_script`.
    output : bytes
        Its output, whose last line is a JSON object unless the process crashed.

    Returns
    -------
    str
    """
    try:
        failure = json.loads(output.decode("utf-8", "replace").splitlines()[-1])
    except (IndexError, ValueError):
        return f"{library} crashes on it (exit code {code})"
    missing = failure.get("missing")
    if missing:
        module = missing.partition(".")[0]
        needed_by = "" if module in (library, "vtkmodules") else f" for {library}"
        advice = _INSTALL.get(module, f"run: pip install {module}")
        return f"{library if not needed_by else module}{needed_by} is not installed ({advice})"
    packages = " ".join(find_missing_packages()) if library == "gmsh" else ""
    if packages:
        return f"gmsh cannot be loaded (run: apt-get install {packages})"
    reason = escape_unprintable(" ".join(failure["reason"].split()))[:_MAX_REASON]
    return f"{library} {failure['version']} cannot read it ({reason.rstrip(': ')})"
