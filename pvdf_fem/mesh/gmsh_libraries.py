"""Shared libraries that gmsh's wheel needs but does not contain, with their Debian packages.

The script `run` executes this module before any Python package is installed, to print the missing
packages.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterator

#: Debian package of each library.
PACKAGES = {
    "libGL.so.1": "libgl1",
    "libGLU.so.1": "libglu1-mesa",
    "libX11.so.6": "libx11-6",
    "libXcursor.so.1": "libxcursor1",
    "libXext.so.6": "libxext6",
    "libXfixes.so.3": "libxfixes3",
    "libXft.so.2": "libxft2",
    "libXinerama.so.1": "libxinerama1",
    "libXrender.so.1": "libxrender1",
    "libfontconfig.so.1": "libfontconfig1",
    "libgomp.so.1": "libgomp1",
    "libstdc++.so.6": "libstdc++6",
    "libz.so.1": "zlib1g",
}


class GmshMissingError(ImportError):
    """gmsh cannot be imported; the message says which packages to install."""


class GmshInUseError(RuntimeError):
    """Another part of the program has a gmsh session, whose options and models would be lost."""


def find_missing_packages() -> Iterator[str]:
    """Yield the Debian packages of the libraries in `PACKAGES` that cannot be loaded.

    Loads the libraries that exist into the process. Yields nothing on systems other than Linux.
    """
    if sys.platform != "linux":
        return
    for library, package in PACKAGES.items():
        try:
            ctypes.CDLL(library)
        except OSError:
            yield package


def describe_missing_gmsh(error: Exception) -> str:
    """Return an error message for a failed import of gmsh, with advice on what to install."""
    packages = " ".join(find_missing_packages())
    if packages:
        advice = f"install the missing libraries: apt-get install {packages}"
    else:
        advice = "install it again"
    return f"gmsh, which makes the meshes, cannot be loaded ({error}); {advice}"


if __name__ == "__main__":
    print(*find_missing_packages(), sep="\n")
