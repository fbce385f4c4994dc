"""Sections of an input deck: parts of the film with the same layers, as one homogeneous sheet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.placed.patch import Layer
from pvdf_fem.view.files.mesh_grid import MeshGrid

#: Relative difference of moduli below which a sheet counts as isotropic.
ISOTROPY_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class EngineeringConstants:
    """Plane-stress constants of an orthotropic sheet along x and y.

    Parameters
    ----------
    E1, E2 : float
        Young's moduli along x and y in Pa.
    nu12 : float
        Poisson's ratio: minus the strain along y per strain along x, under a stress along x.
    G12 : float
        Shear modulus in Pa.
    """

    E1: float
    E2: float
    nu12: float
    G12: float

    @classmethod
    def from_stiffness(cls, stiffness: Array) -> EngineeringConstants:
        """Compute the constants of a plane-stress stiffness.

        Parameters
        ----------
        stiffness : ndarray, shape (3, 3)
            Stiffness in Pa, without coupling of shear and extension.

        Returns
        -------
        EngineeringConstants
        """
        compliance = np.linalg.inv(stiffness)
        E1 = 1.0 / compliance[0, 0]
        return cls(
            E1=float(E1),
            E2=float(1.0 / compliance[1, 1]),
            nu12=float(-compliance[0, 1] * E1),
            G12=float(1.0 / compliance[2, 2]),
        )

    @property
    def is_isotropic(self) -> bool:
        """Whether the sheet has the same properties in all directions."""
        shear_modulus = self.E1 / (2.0 * (1.0 + self.nu12))
        differences = (self.E2 / self.E1 - 1.0, self.G12 / shear_modulus - 1.0)
        return bool(np.abs(differences).max() < ISOTROPY_TOLERANCE)


@dataclass(frozen=True, eq=False)
class Section:
    """A part of the film whose layers are replaced by one sheet of the film's thickness.

    The sheet has the membrane forces of all layers together, under every strain.

    Parameters
    ----------
    label : str
        Name of the element set and of the material.
    elements : ndarray of int
        Indices of the elements.
    stiffness : ndarray, shape (3, 3)
        Plane-stress stiffness of the sheet in Pa.
    prestrain : ndarray, shape (3,)
        Elastic strain of the sheet on the flat clamped film.
    density : float
        Mass per area divided by the film's thickness, in kg/m³.
    """

    label: str
    elements: Indices
    stiffness: Array
    prestrain: Array
    density: float

    @property
    def constants(self) -> EngineeringConstants:
        """The elastic constants of the sheet."""
        return EngineeringConstants.from_stiffness(self.stiffness)

    @property
    def prestress(self) -> Array:
        """Stress S11, S22, S12 in Pa of the sheet on the flat clamped film."""
        return self.stiffness @ self.prestrain

    def compute_film_stress(self, stress: Array, film: Film) -> Array:
        """Compute the stress of the film alone from that of the sheet.

        Parameters
        ----------
        stress : ndarray, shape (n, 3)
            Second Piola-Kirchhoff stress of the sheet in Pa.
        film : Film
            The film without its layers.

        Returns
        -------
        ndarray, shape (n, 3)
        """
        strain = np.linalg.solve(self.stiffness, stress.T).T - self.prestrain
        return (strain + film.prestrain) @ film.stiffness


def make_sections(film: Film, grid: MeshGrid) -> list[Section]:
    """Divide the film into sections of the same layers.

    Parameters
    ----------
    film : Film
        The film with its layers; all of them obey Hooke's law.
    grid : MeshGrid
        The mesh, whose patches include those of the layers.

    Returns
    -------
    list of Section
        ``film`` for a film without layers, otherwise ``section_1``, ``section_2``, ...; each
        element is in one of them.
    """
    layers = film.layers
    covered = {name: elements for name, elements in grid.patches.items() if name in layers}
    if not covered:
        return [_make_section(film, [], "film", elements=np.arange(len(grid.triangles)))]
    combinations = grid.with_patches(covered).find_combinations()
    sections = []
    for number, combination in enumerate(combinations, start=1):
        above = [layers[name] for name in combination.patches]
        label = f"section_{number}"
        sections.append(_make_section(film, above, label, elements=combination.elements))
    return sections


def _make_section(film: Film, layers: list[Layer], label: str, elements: Indices) -> Section:
    """Make the section of the film under some layers.

    Parameters
    ----------
    film : Film
        The film.
    layers : list of Layer
        The layers on it.
    label : str
        Name of the section.
    elements : ndarray of int
        Indices of its elements.

    Returns
    -------
    Section
    """
    stiffness = film.stiffness
    prestress = film.stiffness @ film.prestrain
    density = film.density
    for layer in layers:
        ratio = layer.patch.thickness / film.thickness
        stiffness = stiffness + ratio * layer.stiffness
        prestress = prestress + ratio * layer.stiffness @ layer.prestrain
        density += ratio * layer.density
    prestrain: Array = np.asarray(np.linalg.solve(stiffness, prestress), dtype=float)
    return Section(label, elements, stiffness, prestrain=prestrain, density=density)
