"""A whole input deck of CalculiX or Abaqus: mesh, material, clamped rim, tension and loads."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pvdf_fem.mesh.subdomains import RIM, make_subdomain_name
from pvdf_fem.scene.scene import Scene
from pvdf_fem.view.deck.deck_loads import DeckLoads
from pvdf_fem.view.deck.deck_scene import format_scene_comments
from pvdf_fem.view.deck.dialect import Dialect
from pvdf_fem.view.deck.section import Section, make_sections
from pvdf_fem.view.files.inp import format_grid, format_ids, format_number, make_labels
from pvdf_fem.view.files.mesh_grid import MeshGrid

#: Type of the elements: in CalculiX 2.20 these pass the patch test, while M3D6 does not.
ELEMENT = "M3D3"
#: Largest first increment of the loading step, as a fraction of the load.
FIRST_INCREMENT = 0.05
#: Largest force of the first increment divided by the film's tension in N/m and its radius. This
#: converges on films of 0.4 to 12 N/m under 1 to 5 N; a hundred times more fails.
FIRST_FORCE = 0.13
#: Number of the increment after which results are written: only the last one of a step.
LAST_INCREMENT = 9999


@dataclass(frozen=True, eq=False)
class InputDeck:
    """The content of an input deck.

    Parameters
    ----------
    scene : Scene
        The scene, for material, tension and electrodes.
    grid : MeshGrid
        Mesh of three-node triangles with the scene's patches.
    loads : DeckLoads
        The loads on this mesh.
    dialect : Dialect
        The language of the program.
    """

    scene: Scene
    grid: MeshGrid
    loads: DeckLoads
    dialect: Dialect

    def format(self) -> str:
        """Return the deck as text in ASCII."""
        lines = [
            "** A film in SI units (m, N, Pa, kg/m3, K) at z = 0. Step 1 cools the clamped film,",
            "** which is kept flat, and step 2 loads it. The results are printed at the end.",
        ]
        lines += format_scene_comments(self.scene)
        lines += format_grid(self.grid, ELEMENT)
        sections = make_sections(self.scene.film, self.grid)
        for section in sections:
            lines += self._format_section(section)
        lines += self._format_pressure_sets()
        lines += [f"*BOUNDARY\n{RIM}, 1, 3", "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nnodes, 0."]
        lines += self._format_cooling_step()
        lines += self._format_loading_step()
        return "\n".join(lines) + "\n"

    @property
    def cooling(self) -> float:
        """Change of temperature in K that gives the tension; -1 if the scene states none."""
        film = self.scene.film
        change = (film.temperature_change_K or 0.0) + (film.warming_K or 0.0)
        return change if film.temperature_change_K is not None and change else -1.0

    @property
    def first_increment(self) -> float:
        """First increment of the load: small if the tension is small beside the load."""
        film = self.scene.film
        tension = film.thickness * float(film.prestress[:2].min())
        corners = self.grid.points[self.grid.triangles]
        areas = 0.5 * np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
        force = float(np.abs(self.loads.forces).sum() + np.abs(self.loads.pressures) @ areas)
        if not force:
            return FIRST_INCREMENT
        return min(FIRST_INCREMENT, FIRST_FORCE * tension * film.radius / force)

    def _format_section(self, section: Section) -> Iterator[str]:
        """Yield the lines of a section: its set of elements, its material and its thickness."""
        if section.label != "film":
            yield f"*ELSET, ELSET={section.label}"
            yield from format_ids(section.elements)
        constants = section.constants
        orientation = ""
        if not constants.is_isotropic and self.dialect.orientation:
            orientation = f", ORIENTATION={self.dialect.orientation}"
            if section.label in ("film", "section_1"):
                yield from self.dialect.format_orientation()
        yield f"*MATERIAL, NAME=material_{section.label}"
        if constants.is_isotropic:
            yield "*ELASTIC"
            yield f"{format_number(constants.E1)}, {format_number(constants.nu12)}"
        else:
            yield from self.dialect.format_orthotropic(constants)
        yield from self._format_expansion(section)
        yield f"*DENSITY\n{format_number(section.density)}"
        yield (
            f"*MEMBRANE SECTION, ELSET={section.label}, MATERIAL=material_{section.label}"
            + orientation
        )
        yield format_number(self.scene.film.thickness)

    def _format_expansion(self, section: Section) -> Iterator[str]:
        """Yield the thermal expansion with which the cooling gives the section its prestrain."""
        expansion_1, expansion_2, _ = -section.prestrain / self.cooling
        if np.isclose(expansion_1, expansion_2, rtol=1e-12, atol=0.0):
            yield "*EXPANSION, ZERO=0."
            yield format_number(expansion_1)
        else:
            yield "*EXPANSION, TYPE=ORTHO, ZERO=0."
            yield ", ".join(map(format_number, (expansion_1, expansion_2, 0.0)))

    def _format_pressure_sets(self) -> Iterator[str]:
        """Yield a set of elements for each value of the pressure."""
        for number, value in enumerate(self._pressure_values, start=1):
            yield f"*ELSET, ELSET=pressed_{number}"
            yield from format_ids(np.flatnonzero(self.loads.pressures == value))

    @property
    def _pressure_values(self) -> list[float]:
        """The different pressures in Pa other than zero."""
        values = np.unique(self.loads.pressures)
        return [float(value) for value in values if value]

    def _format_cooling_step(self) -> Iterator[str]:
        """Yield the step that stretches the film, whose nodes are kept in their plane."""
        yield "*STEP, NLGEOM\n*STATIC\n1., 1."
        yield "*BOUNDARY\nnodes, 3, 3"
        yield f"*TEMPERATURE\nnodes, {format_number(self.cooling)}"
        yield "*END STEP"

    def _format_loading_step(self) -> Iterator[str]:
        """Yield the step that loads the film and prints displacements and stresses."""
        yield f"*STEP, NLGEOM, INC=1000\n*STATIC\n{self.first_increment:.3g}, 1."
        yield f"*BOUNDARY, OP=NEW\n{RIM}, 1, 3"
        if self.loads.forces.any():
            yield "*CLOAD"
            for node, force in enumerate(self.loads.forces, start=1):
                for direction in np.flatnonzero(force):
                    yield f"{node}, {direction + 1}, {format_number(force[direction])}"
        for number, value in enumerate(self._pressure_values, start=1):
            label = self.dialect.pressure_label
            yield f"*DLOAD\npressed_{number}, {label}, {format_number(value)}"
        yield f"*NODE PRINT, NSET=nodes, FREQUENCY={LAST_INCREMENT}\nU"
        labels = make_labels(self.grid.patches)
        parameters = f"FREQUENCY={LAST_INCREMENT}{self.dialect.print_parameters}"
        for electrode in self.scene.electrode_list:
            label = labels[make_subdomain_name(electrode.name)]
            yield f"*EL PRINT, ELSET={label}, {parameters}"
            yield self.dialect.element_output
        yield "*END STEP"
