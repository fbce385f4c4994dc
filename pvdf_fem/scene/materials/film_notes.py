"""Notes of a scene about the material of its film: what is unknown, and what sources dispute."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pvdf_fem.scene.materials.catalogue import read_material
from pvdf_fem.scene.materials.material import Material, format_range, join_words
from pvdf_fem.scene.scene_file import format_error

if TYPE_CHECKING:
    from pvdf_fem.scene.film import Film


def find_material_notes(film: Film) -> list[str]:
    """Find what a user should know about a film with a material.

    Parameters
    ----------
    film : Film
        The film of a scene.

    Returns
    -------
    list of str
        Notes of the form ``key = value: reason; advice``: properties that no readable source gives
        and that have their defaults, properties about which sources disagree, and a thickness that
        is not made. Empty for a film without a material.
    """
    if film.material is None:
        return []
    material = read_material(film.material)
    notes = [
        _describe_missing(film, material),
        _describe_disagreement(film, material),
        _describe_thickness(film, material),
    ]
    return [note for note in notes if note]


def _describe_missing(film: Film, material: Material) -> str:
    """Describe the properties without a source that have their defaults; empty if none has."""
    fields = type(film).model_fields
    kept = []
    for name in material.missing:
        if getattr(film, name) == fields[name].default:
            kept.append(f"{name} {fields[name].default:g}")
    if not kept:
        return ""
    reason = f"no readable source gives these values, which are defaults: {', '.join(kept)}"
    return format_error("film.material", material.name, f"{reason}; give your own")


def _describe_disagreement(film: Film, material: Material) -> str:
    """Describe the values of the material about which sources disagree; empty if there are none."""
    disputed = []
    for name, value in material.film_values.items():
        sourced = material.properties[name]
        if sourced.has_disagreement and getattr(film, name) == value:
            disputed.append(f"{name} {value:g} ({format_range(sourced.low, sourced.high)})")
    if not disputed:
        return ""
    reason = f"sources disagree about {join_words(tuple(disputed))}"
    advice = f"see `pvdf-fem materials {material.name}`, and --scene for [uncertain]"
    return format_error("film.material", material.name, f"{reason}; {advice}")


def _describe_thickness(film: Film, material: Material) -> str:
    """Describe a thickness in which the film is not made; empty if it is, or nothing is known."""
    thicknesses = material.thicknesses_um
    if not thicknesses or film.thickness_um in thicknesses:
        return ""
    advice = f"it is made in {material.format_thicknesses()} µm"
    reason = f"is not a thickness of {material.name}; {advice}"
    return format_error("film.thickness_um", film.thickness_um, reason)
