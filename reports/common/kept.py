"""Sections kept between runs: drawn again only when what they are made of has changed.

A section is made of the records of its scenes, the thesis's numbers and the code. Its file's name
has the hash of all three, so that a changed line of code draws everything again.
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path

from pvdf_fem import Scene
from pvdf_fem.files import replacing
from reports.common.page import Section
from reports.common.results import Results
from reports.common.thesis_data import DATA, Thesis

ROOT = Path(__file__).resolve().parents[2]


def kept(
    name: str,
    scenes: Iterable[Scene],
    thesis: Thesis,
    results: Results,
    out: Path,
    make: Callable[[], Section],
) -> Section:
    """The section as it was made before, if that still holds and its files are there; else anew."""
    digest = hashlib.sha256(_code().encode() + repr(thesis).encode())
    for scene in scenes:
        digest.update(f"{scene!r} {results[scene]!r}".encode())
    path = results.folder / f"section-{name}-{digest.hexdigest()[:32]}.pickle"
    if path.is_file():
        section: Section = pickle.loads(path.read_bytes())
        if all((out / block.file).is_file() for block in section.blocks):
            return section
    section = make()
    for old in results.folder.glob(f"section-{name}-*.pickle"):
        old.unlink(missing_ok=True)
    with replacing(path) as part:
        part.write_bytes(pickle.dumps(section))
    return section


@cache
def _code() -> str:
    """Hash of all that may change a section besides records: modules, page and data."""
    digest = hashlib.sha256()
    sources = [*(ROOT / "pvdf_fem").rglob("*.py"), *(ROOT / "reports").rglob("*.py")]
    for path in sorted([*sources, *DATA.iterdir()]):
        digest.update(path.read_bytes())
    return digest.hexdigest()
