"""Patches: layers of limited area that are bonded to the film, and backings of a part of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from pvdf_fem.scene.keys import Affects, Key, make_validation_error
from pvdf_fem.scene.placed.placed_shape import PlacedShape
from pvdf_fem.scene.shapes.shape import COORDINATE

# Keys that film and patches have in common.
MODULUS = Key(
    "GPa", (1e-6, 1e4), usual_limits=(1e-6, 1500.0), likely_units={"MPa": 1e-3, "Pa": 1e-9}
)
EXPANSION = Key("1/K", (-0.1, 0.1), Affects.PRESTRAIN)
BACKING = Key(
    "N/m³", (0.0, 1e15), usual_limits=(1e2, 1e13), likely_units={"N/mm³": 1e9}, example=1e6
)
ONE_SIDED = Key(needs=("backing_N_m3", None))
#: Requirement of the keys that only a patch with a thickness has.
LAYER_KEY = ("thickness_um", None)


class Patch(PlacedShape):
    """A layer bonded to the film, such as tape, ink or solder, or a backing of a part of the film.

    A patch has a thickness, or a backing, or both. Patches may overlap electrodes, probes and other
    patches, and extend beyond the rim. Properties of the material that are not given are those of
    the film.
    """

    thickness_um: Annotated[float | None, Key("µm", (1e-3, 1e5), example=50.0)] = None
    """Thickness; of a layer on both sides, the sum of both. Required unless the patch is only a
    backing."""
    both_sides: Annotated[bool, Key(needs=LAYER_KEY)] = False
    """true: half of the thickness is on either side of the film."""
    youngs_modulus_GPa: Annotated[float | None, replace(MODULUS, needs=LAYER_KEY, example=3.0)] = (
        None
    )
    """Young's modulus of an isotropic layer."""
    poisson_ratio: Annotated[
        float | None, Key("", (0.0, 0.4999), needs=("youngs_modulus_GPa", None), example=0.3)
    ] = None
    """Poisson's ratio."""
    density_kg_m3: Annotated[
        float | None,
        Key("kg/m³", (0.0, 1e5), Affects.DYNAMICS, needs=LAYER_KEY, example=1400.0),
    ] = None
    """Density."""
    bonded: Annotated[
        Literal["at rest", "before stretching"], Key(needs=LAYER_KEY, neutral="at rest")
    ] = "at rest"
    """at rest: the layer is bonded to the stretched film and is free of stress. before stretching:
    it is stretched, or cooled and clamped, together with the film."""
    thermal_expansion_per_K: Annotated[
        float | None, Key("1/K", (-0.1, 0.1), needs=("bonded", "before stretching"), example=1e-5)
    ] = None
    """Coefficient of thermal expansion."""
    backing_N_m3: Annotated[float | None, BACKING] = None
    """Stiffness of an elastic backing below this part of the film, in addition to that below the
    whole film and to those of other patches."""
    backing_one_sided: Annotated[bool, ONE_SIDED] = False
    """true: the film lifts off this backing. false: it is bonded to it."""
    x_mm: Annotated[float, COORDINATE]
    y_mm: Annotated[float, COORDINATE]

    @model_validator(mode="after")
    def _require_layer_or_backing(self) -> Self:
        """Refuse a patch that is neither a layer nor a backing."""
        if self.thickness_um is None and not self.backing_N_m3:
            reason = "is required; give the thickness of a layer, or backing_N_m3 of a backing"
            raise make_validation_error(reason, key="thickness_um")
        return self

    @classmethod
    def list_layer_keys(cls) -> set[str]:
        """Return the names of a patch's keys other than those of its shape and position."""
        return set(cls.model_fields) - set(PlacedShape.model_fields)

    def compute_stiffness(self, film_stiffness: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compute the plane-stress stiffness of the layer in Pa, shape (3, 3).

        Without a Young's modulus it is `film_stiffness`, that of the film; without a Poisson's
        ratio, that of the film is taken, or the mean √(ν12 ν21) of an orthotropic film.
        """
        modulus = self.youngs_modulus_GPa
        if modulus is None:
            return film_stiffness
        nu = self.poisson_ratio
        if nu is None:
            C = film_stiffness
            nu = float(C[0, 1] / np.sqrt(C[0, 0] * C[1, 1]))
        return 1e9 * compute_plane_stress_stiffness(modulus, modulus, nu12=nu)

    @property
    def thickness(self) -> float:
        """Thickness in m; 0 of a patch that is only a backing."""
        return (self.thickness_um or 0.0) / 1e6


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
