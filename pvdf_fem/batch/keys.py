"""Keys under which results are stored: hashes over inputs and over the code that made them."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib import metadata
from pathlib import Path

from pvdf_fem.film.loads.profiles import pin_profile_files
from pvdf_fem.scene.keys import Affects, select_by_effect
from pvdf_fem.scene.scene import Scene

#: Folders of the package whose code influences the numbers of a record.
NUMERICAL_FOLDERS = (
    "readings",
    "scene",
    "mesh",
    "film",
    "problem",
    "electrodes",
    "solver",
    "batch",
)
#: Libraries whose versions influence the numbers of a record.
NUMERICAL_PACKAGES = ("gmsh", "numpy", "scikit-fem", "scipy")


def make_record_key(scene: Scene, folders: tuple[str, ...] = NUMERICAL_FOLDERS) -> str:
    """Make the key under which the record of a scene is stored.

    Parameters
    ----------
    scene : Scene
        The scene. Keys without influence on a record are left out of the hash.
    folders : tuple of str, optional
        Folders of the package whose code enters the hash.

    Returns
    -------
    str
        A hash over the scene, its profile files, the code and the versions of libraries.
    """
    (scene,) = pin_profile_files([scene])
    effects = set(Affects)
    if not scene.film.coupling:  # with coupling, amplifiers and permittivity act on the film
        effects.remove(Affects.INSTRUMENT)
    solved = repr(select_by_effect(scene, *effects))
    return hashlib.sha256((hash_code(folders) + solved).encode()).hexdigest()


@cache
def hash_code(folders: tuple[str, ...] = NUMERICAL_FOLDERS) -> str:
    """Hash the modules in folders of the package, and the versions of `NUMERICAL_PACKAGES`.

    The hash is cached, so that a later change of a file is not seen.
    """
    digest = hashlib.sha256()
    for name in NUMERICAL_PACKAGES:
        digest.update(f"{name} {metadata.version(name)}\n".encode())
    for module in list_modules(folders):
        digest.update(module.read_bytes())
    return digest.hexdigest()


def list_modules(folders: tuple[str, ...] = NUMERICAL_FOLDERS) -> list[Path]:
    """List the modules in folders of the package, and `arrays.py`, which all of them import."""
    package = Path(__file__).parents[1]
    modules: list[Path] = []
    for folder in folders:
        modules += package.joinpath(folder).rglob("*.py")
    return [package / "arrays.py", *sorted(modules)]
