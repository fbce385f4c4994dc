"""Patches: layers of limited area that are bonded to the film."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pvdf_fem.scene.keys import Affects, Key
from pvdf_fem.scene.placed.placed_shape import PlacedShape
from pvdf_fem.scene.shapes.shape import COORDINATE

# Keys that the materials of film and patches have in common.
MODULUS = Key(
    "GPa", (1e-6, 1e4), usual_limits=(1e-6, 1500.0), likely_units={"MPa": 1e-3, "Pa": 1e-9}
)
EXPANSION = Key("1/K", (-0.1, 0.1), Affects.PRESTRAIN)


class Patch(PlacedShape):
    """A layer bonded to the film, such as tape, ink or solder.

    Layers may overlap electrodes, probes and other layers, and extend beyond the rim. Properties of
    the material that are not given are those of the film.
    """

    thickness_um: Annotated[float, Key("µm", (1e-3, 1e5), example=50.0)]
    """Thickness; of a layer on both sides, the sum of both."""
    both_sides: Annotated[bool, Key()] = False
    """true: half of the thickness is on either side of the film."""
    youngs_modulus_GPa: Annotated[float | None, replace(MODULUS, example=3.0)] = None
    """Young's modulus of an isotropic layer."""
    poisson_ratio: Annotated[
        float | None, Key("", (0.0, 0.4999), needs=("youngs_modulus_GPa", None), example=0.3)
    ] = None
    """Poisson's ratio."""
    density_kg_m3: Annotated[
        float | None, Key("kg/m³", (0.0, 1e5), Affects.DYNAMICS, example=1400.0)
    ] = None
    """Density."""
    bonded: Literal["at rest", "before stretching"] = "at rest"
    """at rest: the layer is bonded to the stretched film and is free of stress. before stretching:
    it is stretched, or cooled and clamped, together with the film."""
    thermal_expansion_per_K: Annotated[
        float | None, Key("1/K", (-0.1, 0.1), needs=("bonded", "before stretching"), example=1e-5)
    ] = None
    """Coefficient of thermal expansion."""
    x_mm: Annotated[float, COORDINATE]
    y_mm: Annotated[float, COORDINATE]

    @classmethod
    def list_layer_keys(cls) -> set[str]:
        """Return the names of a patch's keys other than those of its shape and position."""
        return set(cls.model_fields) - set(PlacedShape.model_fields)

    @property
    def thickness(self) -> float:
        """Thickness in m."""
        return self.thickness_um / 1e6


class Layer(NamedTuple):
    """The material of a patch, where values that the patch does not give are those of the film."""

    patch: Patch
    stiffness: NDArray[np.float64]  #: Plane-stress stiffness in Pa, shape (3, 3).
    prestrain: NDArray[np.float64]  #: Elastic strain on the flat film, shape (3,).
    expansion: float  #: Coefficient of thermal expansion in 1/K.
    density: float  #: In kg/m³.


def compute_plane_stress_stiffness(E1: Any, E2: Any, nu12: Any, G: Any = None) -> NDArray[Any]:
    """Compute the stiffness of an orthotropic sheet in plane stress.

    All parameters may be complex (for complex-step derivatives).

    Parameters
    ----------
    E1, E2 : float or complex
        Young's moduli along x and y.
    nu12 : float or complex
        Poisson's ratio: contraction along y under stress along x.
    G : float or complex, optional
        Shear modulus; by default Huber's estimate √(E1 E2)/(2(1 + √(ν12 ν21))), with
        ν21 = ν12 E2/E1.

    Returns
    -------
    ndarray, shape (3, 3)
        In Voigt's notation with engineering shear, in the unit of the moduli.
    """
    nu21 = nu12 * E2 / E1
    if G is None:
        # ν12 √(E2/E1) is √(ν12 ν21) with the sign of ν12
        G = np.sqrt(E1 * E2) / (2 * (1 + nu12 * np.sqrt(E2 / E1)))
    m = 1 - nu12 * nu21
    return np.array([[E1 / m, nu12 * E2 / m, 0], [nu12 * E2 / m, E2 / m, 0], [0, 0, G]])
