"""The film and its material, and the air about it."""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Discriminator, Field, StrictBool, Tag, ValidationInfo, field_validator

from pvdf_fem.scene.quantity import Finite, Length, Modulus, Number, Section, refusal, within
from pvdf_fem.scene.scene_file import quote

Value = TypeVar("Value")


def _number_or_pair(value: Any) -> str:
    return "pair" if isinstance(value, list | tuple) else "number"


#: A number, or a pair of numbers along x and y.
NumberOrPair = Annotated[
    Annotated[Value, Tag("number")] | Annotated[tuple[Value, Value], Tag("pair")],
    Discriminator(_number_or_pair),
]


class Film(Section):
    """The film: a flat disc clamped on its rim, centred on the origin.

    `youngs_modulus_GPa` is a number, or a pair [E1, E2] along x and y; `poisson_ratio` is then
    ν12 (ν21 = ν12 E2/E1). Without `shear_modulus_GPa`, Huber's estimate
    √(E1 E2)/(2(1 + √(ν12 ν21))) is taken, which is E/(2(1 + ν)) for an isotropic film.
    `bending` adds the film's stiffness as a plate: always, never, or (``"auto"``) where it could
    change a charge by more than ``numerics.tolerance``.

    `permittivity` is that of the film across its thickness, relative to that of the vacuum.
    `loss_tangent` is that of its stiffness, for oscillations; None is a film without damping.

    `compression` says what the model does with compressive stress: ``refuse`` warns of it, counts
    what wrinkles would change as an error, and takes no membrane for a result of which they would
    change a charge by more than a tenth; ``tension-field`` lets the film wrinkle.

    The clamped film is stretched either by its cooling, `temperature_change_K` (-1 K where neither
    is given), or to `pretension_N_m`, its tension at rest: a number, or a pair along x and y. In
    compression, below zero, it is like a film that is heated.
    """

    radius_mm: Length = 45.0
    thickness_um: Annotated[Finite, within(1e-3, 1e6, "µm")] = 25.0
    youngs_modulus_GPa: NumberOrPair[Modulus] = 2.0
    poisson_ratio: Number = Field(0.34, validate_default=True)
    shear_modulus_GPa: Modulus | None = None
    density_kg_m3: Annotated[Finite, within(1e-3, 1e6, "kg/m³")] = 1760.0
    thermal_expansion_per_K: Annotated[Finite, within(-1.0, 1.0, "1/K")] = 110e-6
    pretension_N_m: NumberOrPair[Annotated[Finite, within(-1e6, 1e6, "N/m")]] | None = None
    temperature_change_K: Annotated[Finite, within(-1e4, 1e4, "K")] | None = Field(
        None, validate_default=True
    )
    bending: bool | Literal["auto"] = False
    d31_pC_N: Number = 8.0
    d32_pC_N: Number = 8.0
    permittivity: Annotated[Finite, within(1.0, 1e6)] = 11.0
    loss_tangent: Annotated[Finite, within(0.0, 1.0)] | None = None
    compression: Literal["refuse", "tension-field"] = "refuse"

    @field_validator("poisson_ratio")
    @classmethod
    def _elastic_energy_is_positive(cls, value: float, info: ValidationInfo) -> float:
        modulus = info.data.get("youngs_modulus_GPa")
        if modulus is None:  # refused already
            return value
        if isinstance(modulus, tuple):
            E1, E2 = modulus
            # nearer to 1, ν12 ν21 makes a stiffness that is singular to rounding
            if value**2 * E2 >= E1 * (1 - 1e-9):
                bound = np.sqrt(E1 / E2)
                raise refusal(f"makes ν12 ν21 at least 1; give a value below {bound:.6g}")
        elif not 0 <= value < 0.5:
            raise refusal("is outside of [0, 0.5); give Poisson's ratio of a real isotropic film")
        return value

    @field_validator("temperature_change_K")
    @classmethod
    def _is_stretched_in_one_way(cls, value: float | None, info: ValidationInfo) -> float | None:
        if (pretension := info.data.get("pretension_N_m")) is None:
            return -1.0 if value is None else value
        if value is not None:
            other = f"film.pretension_N_m = {quote(pretension)}"
            raise refusal(f"stands beside {other}; remove one of the two")
        return None

    @field_validator("bending", mode="before")
    @classmethod
    def _is_a_choice(cls, value: Any) -> Any:
        if isinstance(value, bool) or value == "auto":
            return value
        raise refusal('is not known; give true, false or "auto"')

    @field_validator("compression")
    @classmethod
    def _wrinkles_have_no_bending(cls, value: str, info: ValidationInfo) -> str:
        if value == "tension-field" and info.data.get("bending"):
            raise refusal("is of a film without bending; give film.bending = false")
        return value

    @property
    def radius(self) -> float:
        """Radius in m."""
        return self.radius_mm / 1e3

    @property
    def thickness(self) -> float:
        """Thickness in m."""
        return self.thickness_um / 1e6

    @property
    def density(self) -> float:
        """Density in kg/m³."""
        return self.density_kg_m3

    @property
    def d31(self) -> float:
        """Piezoelectric coefficient along x in C/N."""
        return self.d31_pC_N / 1e12

    @property
    def d32(self) -> float:
        """Piezoelectric coefficient along y in C/N."""
        return self.d32_pC_N / 1e12

    @property
    def strain_at_rest(self) -> NDArray[np.float64]:
        """Elastic strain of the flat clamped film, (3,), with engineering shear."""
        if self.temperature_change_K is not None:
            strain = -self.thermal_expansion_per_K * self.temperature_change_K
            return strain * np.array([1.0, 1.0, 0.0]) + 0.0  # no negative zeros
        return np.asarray(np.linalg.solve(self.stiffness, self.stress_at_rest) + 0.0)

    @property
    def stress_at_rest(self) -> NDArray[np.float64]:
        """Stress in Pa, (3,), of the flat clamped film if it carries compression; without shear."""
        if self.pretension_N_m is None:
            return self.stiffness @ self.strain_at_rest
        return np.append(np.broadcast_to(self.pretension_N_m, 2), 0.0) / self.thickness

    @property
    def stiffness(self) -> NDArray[np.float64]:
        """Plane-stress stiffness in Pa, shape (3, 3): components 11, 22, 12, engineering shear."""
        modulus = self.youngs_modulus_GPa
        E1, E2 = modulus if isinstance(modulus, tuple) else (modulus, modulus)
        return 1e9 * plane_stress(E1, E2, self.poisson_ratio, self.shear_modulus_GPa)


class Air(Section):
    """The air on both sides of the film; around its rim it flows unless there is a `baffle`."""

    density_kg_m3: Annotated[Finite, within(0.0, 1e6, "kg/m³")] = 1.204
    baffle: StrictBool = True


def plane_stress(E1: Any, E2: Any, nu12: Any, G: Any = None) -> NDArray[Any]:
    """Stiffness (3, 3) of an orthotropic sheet, Voigt, in the unit of its moduli. Numbers may be
    complex, for derivatives. Without `G`, Huber's estimate is taken."""
    nu21 = nu12 * E2 / E1
    if G is None:
        # ν12 √(E2/E1) is √(ν12 ν21) with the sign of ν12
        G = np.sqrt(E1 * E2) / (2 * (1 + nu12 * np.sqrt(E2 / E1)))
    m = 1 - nu12 * nu21
    return np.array([[E1 / m, nu12 * E2 / m, 0], [nu12 * E2 / m, E2 / m, 0], [0, 0, G]])
