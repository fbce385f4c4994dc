"""Write drawings of a scene at scale 1:1."""

from __future__ import annotations

from pathlib import Path

from pvdf_fem.files import FileError
from pvdf_fem.scene.arguments import SceneLike, as_scene, coerce
from pvdf_fem.scene.scene_file import format_error, suggest
from pvdf_fem.view.drawings.dxf import VERSIONS, write_dxf
from pvdf_fem.view.drawings.sheet import make_sheet
from pvdf_fem.view.drawings.svg import write_svg

#: Extensions of the formats.
FORMATS = (".dxf", ".svg", ".pdf")


def draw(
    scene: SceneLike,
    path: Path | str,
    *,
    probe: bool = False,
    dimensions: bool = True,
    dxf_version: str = "R2010",
) -> None:
    """Draw the rim, electrodes and patches of a scene at scale 1:1, as DXF, SVG or PDF.

    Parameters
    ----------
    scene : Scene, str, Path, mapping or HasScene
        The scene, or anything from which `as_scene` makes one.
    path : Path or str
        File to write; its extension ``.dxf``, ``.svg`` or ``.pdf`` chooses the format.
    probe : bool
        Whether to draw the outlines of probes, too, on a layer of their own.
    dimensions : bool
        Whether to draw dimensions and a title, on a layer of their own.
    dxf_version : str
        ``R2010``, or ``R12`` for old machines: it states no unit (the drawing is in mm), and has
        arcs within 0.1 µm in place of ellipses.

    Raises
    ------
    ValueError
        If the extension or the version is unknown.
    FileError
        If the file cannot be written, or ezdxf, which DXF requires, is not installed.

    Notes
    -----
    The layers are RIM, ELECTRODES, PATCHES and PROBE with outlines only, NAMES and DIMENSIONS. In
    SVG they are groups with these ids, classes and Inkscape labels. Circles and arcs are exact in
    DXF and SVG; in PDF they are Bézier curves within 4e-7 of their radius.

    Examples
    --------
    >>> draw(Scene.example("triangle"), "electrodes.svg")
    """
    target = coerce("path", path, Path)
    is_probe_drawn = coerce("probe", probe, bool)
    has_dimensions = coerce("dimensions", dimensions, bool)
    extension = target.suffix.lower()
    if extension not in FORMATS:
        reason = f"has no extension of a known format; choose from {' '.join(FORMATS)}"
        raise ValueError(format_error("path", str(path), reason))
    if dxf_version not in VERSIONS:
        reason = f"is not a version of DXF that is written; {suggest(dxf_version, VERSIONS)}"
        raise ValueError(format_error("dxf_version", dxf_version, reason))
    sheet = make_sheet(as_scene(scene), probe=is_probe_drawn, dimensions=has_dimensions)
    if extension == ".dxf":
        try:
            write_dxf(sheet, target, dxf_version)
        except ModuleNotFoundError as error:
            if error.name != "ezdxf":
                raise
            reason = "requires ezdxf, which is not installed"
            advice = 'run: pip install "pvdf-fem[drawings]", or write .svg or .pdf'
            raise FileError(f"{path}: {reason}; {advice}") from None
    elif extension == ".svg":
        write_svg(sheet, target)
    else:
        from pvdf_fem.view.drawings.pdf import write_pdf  # matplotlib is slow to import

        write_pdf(sheet, target)
