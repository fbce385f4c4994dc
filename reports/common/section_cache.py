"""Sections that stay between runs, and are drawn again only when their ingredients change.

A section is made of the records of its scenes, the thesis's numbers, the code, and the table of
errors that `reports.experiment` predicts. The name of its file contains the hash of all four, so
that a changed line of code draws every section again.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cache
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from pvdf_fem import Scene
from pvdf_fem.files import replacing
from reports.common.page import Section
from reports.common.results import Results
from reports.common.thesis_data import DATA, Thesis

ROOT = Path(__file__).resolve().parents[2]
_SECTION = TypeAdapter(Section)
#: The table of `reports.experiment`, which a section shows where that report lies below its page.
TABLE_OF_ERRORS = "predicted_scenes.csv"


def cached_section(
    name: str,
    scenes: Iterable[Scene],
    thesis: Thesis,
    results: Results,
    out: Path,
    make: Callable[[], Section],
) -> Section:
    """The section `name`, read from its file when that is up to date, and made otherwise.

    The file counts as up to date when neither records nor numbers nor code nor that table have
    changed and `out` has the section's pictures and tables. A number that is NaN is read back as
    None, which a page shows in the same way.
    """
    digest = hashlib.sha256(_code().encode() + repr(thesis).encode())
    for scene in scenes:
        digest.update(f"{scene!r} {results[scene]!r}".encode())
    for table in sorted(out.glob(f"*/{TABLE_OF_ERRORS}")):
        digest.update(table.read_bytes())
    path = results.folder / f"section-{name}-{digest.hexdigest()[:32]}.json"
    if path.is_file():
        with suppress(ValidationError):  # a damaged file is replaced
            section = _SECTION.validate_json(path.read_bytes())
            if all((out / block.file).is_file() for block in section.blocks):
                return section
    text = _SECTION.dump_json(make())
    for outdated in results.folder.glob(f"section-{name}-{32 * '?'}.*"):
        outdated.unlink(missing_ok=True)
    with replacing(path) as unfinished:
        unfinished.write_bytes(text)
    return _SECTION.validate_json(text)


@cache
def _code() -> str:
    """Hash of everything besides records that can change a section: modules, page and data."""
    digest = hashlib.sha256()
    modules = [*(ROOT / "pvdf_fem").rglob("*.py"), *(ROOT / "reports").rglob("*.py")]
    for path in sorted([*modules, *Path(__file__).parent.glob("*.j2"), *DATA.iterdir()]):
        digest.update(path.read_bytes())
    return digest.hexdigest()
