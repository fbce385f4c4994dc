"""Reading the mesh of an input deck that `InputDeck` wrote."""

from __future__ import annotations

from itertools import chain
from pathlib import Path

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.files import FileError, read_text
from pvdf_fem.mesh.subdomains import collect_outlines
from pvdf_fem.scene.scene import Scene
from pvdf_fem.view.deck.deck_file import ELEMENT
from pvdf_fem.view.deck.deck_scene import find_scene_difference
from pvdf_fem.view.files.inp import make_labels
from pvdf_fem.view.files.mesh_grid import MeshGrid

#: Maximum size of a deck.
MAX_BYTES = 200_000_000


def read_deck_grid(path: Path, scene: Scene) -> MeshGrid:
    """Read nodes, elements and the sets of a scene's patches from a deck.

    Parameters
    ----------
    path : Path
        The deck.
    scene : Scene
        The scene of the deck.

    Returns
    -------
    MeshGrid
        Its lines along the rim are empty.

    Raises
    ------
    FileError
        If the file is not a deck of this scene.
    """
    text = read_text(path, MAX_BYTES, "an input deck")
    difference = find_scene_difference(text.splitlines(), scene)
    if difference:
        advice = "give the scene of the deck, or write the deck again, and run it"
        raise FileError(f"{path}: is the deck of another scene, with {difference}; {advice}")
    blocks = _read_blocks(text)
    labels = make_labels(collect_outlines(scene))
    try:
        nodes = np.array([row[:3] for row in blocks["NODE"]], dtype=float)
        elements = np.array(blocks[f"ELEMENT {ELEMENT}"], dtype=int)
        if not _is_numbered(nodes[:, 0]) or not _is_numbered(elements[:, 0]):
            raise ValueError
        patches = {}
        for name, label in labels.items():
            words = chain.from_iterable(blocks[f"ELSET {label.upper()}"])
            patches[name] = np.array([int(word) for word in words]) - 1
        triangles = elements[:, 1:4] - 1
        used = np.concatenate([triangles.ravel(), *patches.values()])
        if used.min() < 0 or triangles.max() >= len(nodes):
            raise ValueError
    except (KeyError, ValueError, IndexError) as error:
        reason = "is not the deck of this scene by `pvdf-fem deck`"
        raise FileError(f"{path}: {reason}; write the deck again, and run it") from error
    return MeshGrid(
        order=1,
        points=nodes[:, 1:3],
        triangles=triangles,
        rim_lines=np.zeros((0, 2), dtype=int),
        patches=patches,
    )


def _is_numbered(numbers: Array | Indices) -> bool:
    """Return whether numbers are 1, 2, 3 and so on."""
    return bool((numbers == np.arange(1, len(numbers) + 1)).all())


def _read_blocks(text: str) -> dict[str, list[list[str]]]:
    """Divide a deck into the data lines of its keywords.

    Returns
    -------
    dict of str to list of list of str
        Words of the data lines, by ``NODE``, ``ELEMENT TYPE``, ``ELSET NAME`` and other keywords.
        Lines of the same keyword are joined.
    """
    blocks: dict[str, list[list[str]]] = {}
    rows: list[list[str]] = []
    for line in text.splitlines():
        if line.startswith("**") or not line.strip():
            continue
        if line.startswith("*"):
            keyword, *parameters = [word.strip() for word in line[1:].upper().split(",")]
            values = {}
            for parameter in parameters:
                key, _, value = parameter.partition("=")
                values[key.strip()] = value.strip()
            kind = {"ELEMENT": values.get("TYPE", ""), "ELSET": values.get("ELSET", "")}
            name = f"{keyword} {kind.get(keyword, '')}".strip()
            rows = blocks.setdefault(name, [])
        else:
            rows.append([word.strip() for word in line.split(",") if word.strip()])
    return blocks
