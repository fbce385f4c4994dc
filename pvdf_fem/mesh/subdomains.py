"""The named parts of a mesh: subdomains below outlines, the rim and mirror lines."""

from __future__ import annotations

from skfem import MeshTri2

from pvdf_fem.arrays import Indices
from pvdf_fem.mesh.symmetry import SymmetrySector
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene

RIM = "rim"
FILM = "film"
PROBE = "probe"
#: Boundaries where the first and the second coordinate change sign between a sector and its
#: reflection.
MIRRORS = ("mirror x", "mirror y")


def make_subdomain_name(electrode: str) -> str:
    """Make the name of the mesh subdomain below an electrode."""
    return f"electrode {electrode}"


def collect_outlines(scene: Scene) -> dict[str, Outline]:
    """Collect the outlines that the mesh of a scene follows.

    Parameters
    ----------
    scene : Scene
        The scene.

    Returns
    -------
    dict of str to Outline
        Outlines of electrodes, the film's patches and probes, by the names of their subdomains.
    """
    outlines = {}
    for electrode in scene.electrode_list:
        outlines[make_subdomain_name(electrode.name)] = electrode.outline
    for name, layer in scene.film.layers.items():
        outlines[name] = layer.patch.outline
    for probe in scene.loaded_probes:
        outlines[probe.patch] = probe.outline
    return outlines


def name_mesh_parts(
    mesh: MeshTri2, subdomains: dict[str, Indices], sector: SymmetrySector
) -> MeshTri2:
    """Give a mesh its subdomains, and its rim and mirror lines as boundaries.

    Parameters
    ----------
    mesh : MeshTri2
        With coordinates in m.
    subdomains : dict of str to ndarray of int
        Elements by the name of the subdomain.
    sector : SymmetrySector
        The part of the film that the mesh covers.

    Returns
    -------
    MeshTri2
    """
    rim = mesh.boundary_facets()
    boundaries = {}
    for axis in sector.mirror_axes:
        is_on_line = (mesh.p[axis, mesh.facets[:, rim]] == 0.0).all(axis=0)
        boundaries[MIRRORS[axis]] = rim[is_on_line]
        rim = rim[~is_on_line]
    return mesh.with_subdomains(subdomains).with_boundaries({RIM: rim, **boundaries})
