"""The named parts of a mesh: subdomains inside of outlines, the rim and mirror lines."""

from __future__ import annotations

from dataclasses import replace

from skfem import MeshTri2

from pvdf_fem.arrays import Indices
from pvdf_fem.mesh.size_field import GradedSizes
from pvdf_fem.mesh.symmetry import SymmetrySector
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene

#: Names of the clamped boundary and of the subdomain of the whole film.
RIM = "rim"
FILM = "film"
PROBE = "probe"
#: Names of the mirror lines x = 0 and y = 0 of a sector.
MIRRORS = ("mirror x", "mirror y")


def make_subdomain_name(electrode: str) -> str:
    """Return the name of the subdomain that an electrode of the given name covers."""
    return f"electrode {electrode}"


def collect_outlines(scene: Scene) -> dict[str, Outline]:
    """Collect the outlines in the film that the mesh of a scene follows, without the rim.

    Parameters
    ----------
    scene : Scene
        The scene.

    Returns
    -------
    dict of str to Outline
        Outlines of electrodes, of the film's patches and of loaded probes, by the names of their
        subdomains, in the axes of the scene.
    """
    outlines = {}
    for electrode in scene.electrode_list:
        outlines[make_subdomain_name(electrode.name)] = electrode.outline
    for name, patch in scene.film.named_patches.items():
        outlines[name] = patch.outline
    for probe in scene.loaded_probes:
        outlines[probe.patch] = probe.outline
    return outlines


def add_reflected_sizes(sizes: GradedSizes, sector: SymmetrySector) -> GradedSizes:
    """Return a copy of the sizes that also has sizes for a sector's reflected electrodes.

    A reflected electrode gets the size of its original, or none if the original has none.
    """
    reflected_sizes = {}
    for name, reflected in sector.reflected_electrodes.items():
        size = sizes.patches.get(make_subdomain_name(reflected.electrode))
        if size is not None:
            reflected_sizes[make_subdomain_name(name)] = size
    return replace(sizes, patches=sizes.patches | reflected_sizes)


def name_mesh_parts(
    mesh: MeshTri2, subdomains: dict[str, Indices], sector: SymmetrySector
) -> MeshTri2:
    """Return a copy of a mesh with named subdomains and boundaries.

    Parameters
    ----------
    mesh : MeshTri2
        With coordinates in m, and with nodes exactly on the mirror lines of the sector.
    subdomains : dict of str to ndarray of int
        Indices of the elements by the name of the subdomain.
    sector : SymmetrySector
        The part of the film that the mesh covers.

    Returns
    -------
    MeshTri2
        With these subdomains. The boundary facets are divided into one of the `MIRRORS` for each
        mirror line of the sector, and `RIM` for all others.
    """
    rim = mesh.boundary_facets()
    boundaries = {}
    for axis in sector.mirror_axes:
        is_on_line = (mesh.p[axis, mesh.facets[:, rim]] == 0.0).all(axis=0)
        boundaries[MIRRORS[axis]] = rim[is_on_line]
        rim = rim[~is_on_line]
    return mesh.with_subdomains(subdomains).with_boundaries({RIM: rim, **boundaries})
