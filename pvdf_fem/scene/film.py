"""The film and its material, and the air about it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Discriminator, Field, StrictBool, Tag, ValidationInfo, field_validator

from pvdf_fem.scene.affects import Affects
from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.outline import overlaps
from pvdf_fem.scene.quantity import Finite, Length, Modulus, Number, Section, refusal, within
from pvdf_fem.scene.registry import LAW_CLASSES
from pvdf_fem.scene.scene_file import quote
from pvdf_fem.scene.shapes import MOST_PATCHES, Expansion, Patch

Value = TypeVar("Value")
if TYPE_CHECKING:
    LawName: TypeAlias = str
else:
    LawName = Literal[tuple(LAW_CLASSES)]


def _number_or_pair(value: Any) -> str:
    return "pair" if isinstance(value, list | tuple) else "number"


#: A number, or a pair of numbers along x and y.
NumberOrPair = Annotated[
    Annotated[Value, Tag("number")] | Annotated[tuple[Value, Value], Tag("pair")],
    Discriminator(_number_or_pair),
]

Displacement = Annotated[Finite, within(-1e6, 1e6, "µm")]
Tension = Annotated[Finite, within(-1e6, 1e6, "N/m")]
Kelvins = Annotated[Finite, within(-1e4, 1e4, "K")]


class Layer(NamedTuple):
    """What a patch bonds to the film."""

    patch: Patch
    stiffness: NDArray[np.float64]  #: Of plane stress in Pa, (3, 3).
    strain_at_rest: NDArray[np.float64]  #: Elastic strain on the flat film, (3,).
    expansion: float  #: In 1/K.
    density: float  #: In kg/m³.


class Film(Section):
    """The film: a flat disc clamped on its rim, centred on the origin.

    `youngs_modulus_GPa` is a number, or a pair [E1, E2] along x and y; `poisson_ratio` is then
    ν12 (ν21 = ν12 E2/E1). Without `shear_modulus_GPa`, Huber's estimate
    √(E1 E2)/(2(1 + √(ν12 ν21))) is taken, which is E/(2(1 + ν)) for an isotropic film.
    `bending` adds the film's stiffness as a plate: always, never, or (``"auto"``) where it could
    change a charge by more than ``numerics.tolerance``.

    `permittivity` is that of the film across its thickness, relative to that of the vacuum.
    `loss_tangent` is that of its stiffness, and of its patches', for oscillations; None is a film
    without damping.
    `coupling` lets the voltages of electrodes stiffen the film that no charge amplifier keeps at
    zero voltage (``readout.kind = "voltage"``): always, never, or where that could change a charge
    by more than ``numerics.tolerance``.

    `d33_pC_N`, of PVDF negative, is for the charge that a probe's pressure makes on an electrode
    under it; without a value it is left out. `warming_K` is a change of the film's temperature
    since it was zeroed at rest: it loosens the film.

    `compression` says what the model does with compressive stress: ``refuse`` warns of it, counts
    what wrinkles would change as an error, and takes no membrane for a result of which they would
    change a charge by more than a tenth; ``tension-field`` lets the film wrinkle.

    The clamped film is stretched either by its cooling, `temperature_change_K` (-1 K where neither
    is given), or to `pretension_N_m`, its tension at rest: a number, or a pair along x and y. In
    compression, below zero, it is like a film that is heated.

    `rim_displacement_um` then moves the rim outwards, and the film with all patches: coefficients
    of 1, cos θ, sin θ, cos 2θ, sin 2θ and so on. The strain of that is added to the film's, whose
    disc, electrodes and probe stay in their places: an error of second order, of 3e-4 in charges
    for 9 µm on 45 mm.

    `pyroelectric_uC_m2K` is the charge per area and kelvin of a film that is free to expand; where
    it is not, its stress makes charge by d31 and d32. Without a value it is left out.
    `thermal_diffusivity_m2_s` says how the heat of a probe with `temperature_K` spreads
    (`pvdf_fem.film.loads.heat`).

    `law` is ``hooke``, linear in the Green-Lagrange strain, or ``neo-hookean`` for rubber, which is
    Hooke's law for small strains (`pvdf_fem.film.laws.neo_hookean`); it is that of the patches,
    too.

    `pressure_Pa` is a uniform pressure on the whole film, along z, or with `pressure_follows`
    normal to the deformed film; the film at rest is without it. `gravity_m_s2` is the acceleration
    along z by which the film has a weight, also at rest. Without a value the weight is left out.

    `patches` are layers bonded to the film, as tape or ink, each with a shape and what
    `pvdf_fem.scene.shapes.Bonded` has. They may overlap, and end on or beyond the rim.
    """

    radius_mm: Length = 45.0
    thickness_um: Annotated[Finite, within(1e-3, 1e6, "µm"), Affects.SCALE] = 25.0
    youngs_modulus_GPa: NumberOrPair[Modulus] = 2.0
    poisson_ratio: Number = Field(0.34, validate_default=True)
    shear_modulus_GPa: Modulus | None = None
    density_kg_m3: Annotated[Finite, within(1e-3, 1e6, "kg/m³"), Affects.DYNAMICS] = 1760.0
    thermal_expansion_per_K: Annotated[Expansion, Affects.STRAIN_AT_REST] = 110e-6
    pretension_N_m: Annotated[NumberOrPair[Tension] | None, Affects.STRAIN_AT_REST] = None
    temperature_change_K: Annotated[Kelvins | None, Affects.STRAIN_AT_REST] = Field(
        None, validate_default=True
    )
    bending: bool | Literal["auto"] = False
    d31_pC_N: Annotated[Number, Affects.READING] = 8.0
    d32_pC_N: Annotated[Number, Affects.READING] = 8.0
    permittivity: Annotated[Finite, within(1.0, 1e6), Affects.INSTRUMENT] = 11.0
    loss_tangent: Annotated[Annotated[Finite, within(0.0, 1.0)] | None, Affects.DYNAMICS] = None
    coupling: bool | Literal["auto"] = False
    compression: Literal["refuse", "tension-field"] = "refuse"
    d33_pC_N: Number | None = None
    warming_K: Kelvins | None = None
    rim_displacement_um: tuple[Displacement, ...] | None = None
    pyroelectric_uC_m2K: Annotated[Number | None, Affects.READING] = None
    thermal_diffusivity_m2_s: Annotated[Finite, within(1e-12, 1.0, "m²/s")] = 6e-8
    patches: Annotated[tuple[Patch, ...], Field(max_length=MOST_PATCHES)] | None = None
    law: LawName = "hooke"
    pressure_Pa: Annotated[Finite, within(-1e9, 1e9, "Pa")] | None = None
    pressure_follows: StrictBool = False
    gravity_m_s2: Annotated[Finite, within(-1e6, 1e6, "m/s²")] | None = None

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

    @field_validator("rim_displacement_um")
    @classmethod
    def _has_pairs(cls, value: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if value is not None and len(value) % 2 == 0:
            raise refusal("has a cosine without its sine; give an odd number of coefficients")
        return value

    @field_validator("bending", "coupling", mode="before")
    @classmethod
    def _is_a_choice(cls, value: Any) -> Any:
        if isinstance(value, bool) or value == "auto":
            return value
        raise refusal('is not known; give true, false or "auto"')

    @field_validator("compression")
    @classmethod
    def _wrinkles_are_alone(cls, value: str, info: ValidationInfo) -> str:
        for key in ("bending", "coupling"):
            if value == "tension-field" and info.data.get(key):
                raise refusal(f"is of a film without {key}; give film.{key} = false")
        return value

    @field_validator("patches")
    @classmethod
    def _are_on_the_film(cls, value: Any, info: ValidationInfo) -> Any:
        rim = Circle(np.zeros(2), info.data.get("radius_mm", np.nan) / 1e3)
        for i, patch in enumerate(value or ()):
            if rim.radius > 0.0 and not overlaps(patch.outline, rim):
                raise refusal(f"[{i}] lies outside of the rim; move it inwards or remove it")
            if patch.thermal_expansion_per_K is not None and info.data.get("pretension_N_m"):
                reason = f"[{i}].thermal_expansion_per_K is for a film that is cooled"
                raise refusal(f"{reason}; remove it or film.pretension_N_m")
        return value or None

    @field_validator("law")
    @classmethod
    def _is_of_an_isotropic_film(cls, value: str, info: ValidationInfo) -> str:
        unlike = isinstance(info.data.get("youngs_modulus_GPa"), tuple)
        if value == "neo-hookean" and (unlike or info.data.get("shear_modulus_GPa") is not None):
            raise refusal("is of an isotropic film; give one film.youngs_modulus_GPa alone")
        return value

    @field_validator("pressure_follows")
    @classmethod
    def _has_a_pressure(cls, value: bool, info: ValidationInfo) -> bool:
        if value and not info.data.get("pressure_Pa"):
            raise refusal("is of a pressure on the film; give film.pressure_Pa")
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
    def clamped_permittivity(self) -> float:
        """Permittivity across the film at constant strain in F/m."""
        from scipy.constants import epsilon_0  # scenes are read without scipy

        d = np.array([self.d31, self.d32, 0.0])
        return float(epsilon_0 * self.permittivity - d @ self.stiffness @ d)

    @property
    def zeroed(self) -> Film:
        """The film at rest before it warmed or a pressure came, whose charges are those at rest."""
        before = {"warming_K": None, "pressure_Pa": None, "pressure_follows": False}
        return self.model_copy(update=before)

    @property
    def weight(self) -> float:
        """Weight per area along z in Pa, without that of patches."""
        return self.density * self.thickness * (self.gravity_m_s2 or 0.0)

    @property
    def spread_force(self) -> float:
        """Size in N of the loads on the whole film."""
        return float(abs((self.pressure_Pa or 0.0) + self.weight) * np.pi * self.radius**2)

    @property
    def strain_at_rest(self) -> NDArray[np.float64]:
        """Elastic strain of the flat clamped film, (3,), with engineering shear."""
        if self.temperature_change_K is not None:
            change = self.temperature_change_K + (self.warming_K or 0.0)
            strain = -self.thermal_expansion_per_K * change
            return strain * np.array([1.0, 1.0, 0.0]) + 0.0  # no negative zeros
        return np.asarray(np.linalg.solve(self.stiffness, self.stress_at_rest) + 0.0)

    @property
    def stress_at_rest(self) -> NDArray[np.float64]:
        """Stress in Pa, (3,), of the flat clamped film if it carries compression; without shear."""
        if self.pretension_N_m is None:
            return self.stiffness @ self.strain_at_rest
        given = np.append(np.broadcast_to(self.pretension_N_m, 2), 0.0) / self.thickness
        loosened = self.thermal_expansion_per_K * (self.warming_K or 0.0)
        return np.asarray(given - self.stiffness @ [loosened, loosened, 0.0])

    @property
    def stiffness(self) -> NDArray[np.float64]:
        """Plane-stress stiffness in Pa, shape (3, 3): components 11, 22, 12, engineering shear."""
        modulus = self.youngs_modulus_GPa
        E1, E2 = modulus if isinstance(modulus, tuple) else (modulus, modulus)
        return 1e9 * plane_stress(E1, E2, self.poisson_ratio, self.shear_modulus_GPa)

    @property
    def layers(self) -> dict[str, Layer]:
        """The layers of the patches, by their names in a mesh."""
        return {f"film patch {i}": self._layer(p) for i, p in enumerate(self.patches or (), 1)}

    def _layer(self, patch: Patch) -> Layer:
        C, E, nu = self.stiffness, patch.youngs_modulus_GPa, patch.poisson_ratio
        if E is not None:
            nu = float(C[0, 1] / np.sqrt(C[0, 0] * C[1, 1])) if nu is None else nu
            C = 1e9 * plane_stress(E, E, nu)
        strain = self.zeroed.strain_at_rest * (patch.bonded != "at rest")
        if (alpha := patch.thermal_expansion_per_K) is not None:
            strain[:2] = -alpha * (self.temperature_change_K or 0.0)
        alpha = self.thermal_expansion_per_K if alpha is None else alpha
        strain[:2] -= alpha * (self.warming_K or 0.0)
        density = self.density if patch.density_kg_m3 is None else patch.density_kg_m3
        return Layer(patch, C, strain, alpha, density)

    @property
    def moves_at_rest(self) -> bool:
        """Whether the clamped film, untouched, moves in its plane, since its stress is uneven."""
        stretched = any(layer.strain_at_rest.any() for layer in self.layers.values())
        return stretched or self.rim_displacement_um is not None

    @property
    def is_flat_at_rest(self) -> bool:
        """Whether the clamped film, untouched, is in balance while it is flat."""
        return not (self.moves_at_rest or self.spread_force)

    def rim_strain(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Strain (..., 3) of a displacement g (x, y) that is the rim's there, in units of a: g is
        Re Σ C z^n with C = c - i s of the coefficients of cos nθ and sin nθ."""
        x, y = np.moveaxis(places / self.radius, -1, 0)
        strain = np.zeros((*places.shape[:-1], 3))
        c0, *others = self.rim_displacement_um or (0.0,)
        pairs = [c0, *(c - 1j * s for c, s in zip(others[::2], others[1::2], strict=True))]
        for n, C in enumerate(np.array(pairs) / 1e6 / self.radius):
            g, slope = (C * (x + 1j * y) ** n).real, n * C * (x + 1j * y) ** max(n - 1, 0)
            gx, gy = slope.real, -slope.imag
            strain += np.stack([g + x * gx, g + y * gy, x * gy + y * gx], axis=-1)
        return strain

    @property
    def is_uneven(self) -> bool:
        """Whether it is not the same in all places before any touch."""
        return bool(self.patches or self.rim_displacement_um)


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
