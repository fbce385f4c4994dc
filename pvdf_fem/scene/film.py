"""The table ``[film]`` of a scene: the film and its material."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationInfo, field_validator, model_validator

from pvdf_fem.scene.keys import Affects, Key, NumberOrPair, make_validation_error
from pvdf_fem.scene.materials.catalogue import FILM_NAMES, add_values_of_material
from pvdf_fem.scene.outlines.outline import Outline, has_overlap
from pvdf_fem.scene.placed.patch import (
    BACKING,
    EXPANSION,
    MODULUS,
    ONE_SIDED,
    Layer,
    Patch,
    compute_plane_stress_stiffness,
)
from pvdf_fem.scene.placed.placed_shape import ShapedTable
from pvdf_fem.scene.registry import LAW_CLASSES
from pvdf_fem.scene.scene_file import quote
from pvdf_fem.scene.shapes.shape import Shape

#: Key of a piezoelectric coefficient, the charge per force.
COEFFICIENT = Key(
    "pC/N", (-1e5, 1e5), Affects.READING, usual_limits=(1e-6, 1e5), likely_units={"C/N": 1e12}
)
#: Sizes of films in the example of a scene file.
EXAMPLE_SIZES: Mapping[str, Any] = {
    "width_mm": 60.0,
    "height_mm": 40.0,
    "semi_axes_mm": [40.0, 30.0],
    "side_mm": 90.0,
    "vertices_mm": [[-40.0, -30.0], [40.0, -30.0], [30.0, 30.0], [-30.0, 30.0]],
}


class Film(ShapedTable):
    """The film, flat and clamped along its rim, whose outline may have any flat shape.

    The point (x, y) of the shape, such as the centre of a rectangle, is the film's centre.
    """

    default_shape: ClassVar[str] = "circle"
    default_sizes: ClassVar[Mapping[str, Mapping[str, float]]] = {"circle": {"radius_mm": 45.0}}

    # The name itself affects nothing: its values are those of other keys.
    material: Annotated[
        str | None, Key("", None, Affects.INSTRUMENT, words=FILM_NAMES, example="te-uniaxial")
    ] = None
    """A real film, see `pvdf-fem materials`: its values are the defaults of the keys below, which
    win where they are given."""
    thickness_um: Annotated[
        float,
        Key(
            "µm",
            (1e-3, 1e5),
            Affects.SCALE,
            usual_limits=(0.5, 1e5),
            likely_units={"mm": 1e3, "m": 1e6},
        ),
    ] = 25.0
    """Thickness."""
    youngs_modulus_GPa: Annotated[NumberOrPair[float], MODULUS] = 2.0
    """Young's modulus; for an orthotropic film a pair [E1, E2] along x and y."""
    poisson_ratio: Annotated[float, Field(validate_default=True), Key("", (-10.0, 10.0))] = 0.34
    """Poisson's ratio, at least 0 and below 0.5; for an orthotropic film ν12, where ν21 is
    ν12 E2/E1 and ν12 ν21 must be below 1."""
    shear_modulus_GPa: Annotated[float | None, replace(MODULUS, example=0.746)] = None
    """Shear modulus; by default Huber's estimate √(E1 E2)/(2(1 + √(ν12 ν21))), which is
    E/(2(1 + ν)) for an isotropic film."""
    density_kg_m3: Annotated[
        float,
        Key(
            "kg/m³",
            (1e-3, 1e5),
            Affects.DYNAMICS,
            usual_limits=(50.0, 1e5),
            likely_units={"g/cm³": 1e3},
        ),
    ] = 1760.0
    """Density, for vibrations, the weight and the heat of a warm probe."""
    thermal_expansion_per_K: Annotated[float, EXPANSION] = 110e-6
    """Coefficient of thermal expansion."""
    pretension_N_m: Annotated[
        NumberOrPair[float] | None,
        Key("N/m", (-1e6, 1e6), Affects.PRESTRAIN, example=8.333),
    ] = None
    """Tension of the unloaded clamped film, in place of temperature_change_K; a pair [Nx, Ny] if x
    and y differ. The tension of a heated film is negative."""
    temperature_change_K: Annotated[
        float | None,
        Field(validate_default=True),
        Key("K", (-1e4, 1e4), Affects.PRESTRAIN, example=-1.0),
    ] = None
    """Change of the temperature after clamping: cooling stretches the film. By default -1 if there
    is no pretension_N_m."""
    bending: Annotated[bool | Literal["auto"], Key()] = False
    """true: the film has the bending stiffness of a plate. auto: only where bending could change a
    charge by more than numerics.tolerance."""
    d31_pC_N: Annotated[float, COEFFICIENT] = 8.0
    """Charge per stress along x."""
    d32_pC_N: Annotated[float, COEFFICIENT] = 8.0
    """Charge per stress along y."""
    permittivity: Annotated[float, Key("", (1.0, 1e6), Affects.INSTRUMENT)] = 11.0
    """Relative permittivity across the thickness."""
    loss_tangent: Annotated[
        float | None,
        Key("", (0.0, 1.0), Affects.DYNAMICS, example=0.02),
    ] = None
    """Loss tangent of the stiffness of film and patches, for vibrations; by default there is no
    material damping."""
    coupling: Annotated[bool | Literal["auto"], Key()] = False
    """true: the voltage of electrodes with readout.kind "voltage", which no charge amplifier keeps
    at zero, stiffens the film. auto: only where that could change a charge by more than
    numerics.tolerance."""
    compression: Literal["refuse", "tension-field"] = "refuse"
    """refuse: compressive stress gives a warning. The estimated change of a charge due to wrinkles
    is part of the charge's error, and there is no result if it exceeds a tenth. tension-field: the
    film wrinkles."""
    d33_pC_N: Annotated[float | None, replace(COEFFICIENT, affects=None, example=-15.0)] = None
    """Charge per stress across the thickness, negative for PVDF: the pressure of a probe generates
    charge on an electrode below it. Neglected by default."""
    warming_K: Annotated[float | None, Key("K", (-500.0, 500.0), example=1.0)] = None
    """Warming of the unloaded film since the readings were zeroed, which reduces its tension."""
    rim_displacement_um: Annotated[
        tuple[float, ...] | None, Key("µm", (-1e4, 1e4), example=[0.0, 0.0, 0.0, 1.0, 0.0])
    ] = None
    """Outward displacement of the rim with film and patches after clamping: coefficients of 1,
    cos θ, sin θ, cos 2θ, sin 2θ, ... The positions of disc, electrodes and probe do not change with
    it: a second-order error, 3e-4 of the charges for 9 µm on 45 mm."""
    pyroelectric_uC_m2K: Annotated[
        float | None, Key("µC/(m² K)", (-1e5, 1e5), Affects.READING, example=-25.0)
    ] = None
    """Charge per area and kelvin of a film that is free to expand; the thermal stress of a clamped
    film adds charge through d31 and d32. Neglected by default."""
    thermal_diffusivity_m2_s: Annotated[float, Key("m²/s", (1e-10, 0.01))] = 6e-8
    """Thermal diffusivity, for the heat of a probe with temperature_K."""
    backing_N_m3: Annotated[float | None, BACKING] = None
    """Stiffness of an elastic backing below the whole film, such as an elastomer: pressure per
    deflection. The backing is free of stress and without mass; forces along +z press into it."""
    backing_one_sided: Annotated[bool, ONE_SIDED] = False
    """true: the film lifts off the backing. false: it is bonded to it."""
    patches: Annotated[tuple[Patch, ...] | None, Field(max_length=100)] = None
    """Layers on the film, such as tape, ink and solder, or backings of a part of it."""
    law: Annotated[str, Key(words=LAW_CLASSES)] = "hooke"
    """hooke: stress is linear in the Green-Lagrange strain. neo-hookean: rubber at large strains,
    equal to Hooke's law at small ones. Patches have the law of the film."""
    pressure_Pa: Annotated[float | None, Key("Pa", (-1e8, 1e8), example=300.0)] = None
    """Uniform pressure along z on the whole film, which is absent in the reference state."""
    pressure_follows: Annotated[bool, Key(needs=("pressure_Pa", None))] = False
    """true: the pressure is normal to the deformed film."""
    gravity_m_s2: Annotated[float | None, Key("m/s²", (-1e5, 1e5), example=-9.81)] = None
    """Acceleration along z for the film's weight, which acts in the reference state, too. Neglected
    by default."""

    @classmethod
    def describe_size(cls, name: str, key: Key) -> Key:
        """Return the description of a size of the rim, which affects the mechanics."""
        return replace(
            key,
            affects=None,
            usual_limits=(0.3, 1e5),
            likely_units={"m": 1e3},
            example=EXAMPLE_SIZES.get(name, key.example),
        )

    @model_validator(mode="before")
    @classmethod
    def _add_values_of_material(cls, table: Any) -> Any:
        """Add the values of the material to the table, under keys that it does not have."""
        return add_values_of_material(table) if isinstance(table, Mapping) else table

    @field_validator("poisson_ratio")
    @classmethod
    def _reject_negative_energy(cls, value: float, info: ValidationInfo) -> float:
        """Refuse Poisson's ratios for which the elastic energy is not positive definite."""
        modulus = info.data.get("youngs_modulus_GPa")
        if modulus is None:  # the modulus is invalid, which has an error of its own
            return value
        if isinstance(modulus, tuple):
            E1, E2 = modulus
            # with ν12 ν21 closer to 1, the stiffness would be singular up to round-off
            if value**2 * E2 >= E1 * (1 - 1e-9):
                reason = "is too large, since ν12 ν21 must be below 1"
                advice = f"give a value below {np.sqrt(E1 / E2):.6g}"
                raise make_validation_error(f"{reason}; {advice}")
        elif not 0 <= value < 0.5:
            reason = "must be at least 0 and below 0.5"
            advice = "give the Poisson's ratio of an isotropic material"
            raise make_validation_error(f"{reason}; {advice}")
        return value

    @field_validator("temperature_change_K")
    @classmethod
    def _resolve_cooling(cls, value: float | None, info: ValidationInfo) -> float | None:
        """Return a cooling of 1 K if neither a temperature change nor a pretension is given.

        Refuse a temperature change if a pretension is given, too.
        """
        pretension = info.data.get("pretension_N_m")
        if pretension is None:
            return -1.0 if value is None else value
        if value is not None:
            other = f"film.pretension_N_m = {quote(pretension)}"
            raise make_validation_error(f"is incompatible with {other}; remove one of the two")
        return None

    @field_validator("rim_displacement_um")
    @classmethod
    def _reject_unpaired_coefficient(
        cls, value: tuple[float, ...] | None
    ) -> tuple[float, ...] | None:
        """Refuse an even number of coefficients, in which the last cosine has no sine."""
        if value is not None and len(value) % 2 == 0:
            reason = "has a cosine without the sine; give an odd number of coefficients"
            raise make_validation_error(reason)
        return value

    @field_validator("bending", "coupling", mode="before")
    @classmethod
    def _require_boolean_or_auto(cls, value: Any) -> Any:
        """Refuse values other than true, false and ``"auto"``."""
        if isinstance(value, bool) or value == "auto":
            return value
        raise make_validation_error('is not a valid value; give true, false or "auto"')

    @field_validator("patches")
    @classmethod
    def _reject_patches_outside_rim(cls, value: Any, info: ValidationInfo) -> Any:
        """Refuse patches entirely outside of the rim; return None for an empty list.

        Refuse also a patch's thermal expansion if the film has a pretension, which determines no
        change of the temperature.
        """
        shape: Shape | None = info.data.get("geometry")
        for number, patch in enumerate(value or ()):
            if shape is not None and not has_overlap(patch.outline, shape.outline):
                name = f"film.patches[{number}]"
                reason = f"{name} lies outside of the rim; move it inwards or remove it"
                raise make_validation_error(reason)
            if patch.thermal_expansion_per_K is not None and info.data.get("pretension_N_m"):
                name = f"film.patches[{number}].thermal_expansion_per_K"
                reason = f"{name} requires film.temperature_change_K"
                raise make_validation_error(f"{reason}; remove it or film.pretension_N_m")
        return value or None

    @cached_property
    def outline(self) -> Outline:
        """Outline of the clamped rim in m."""
        return self.geometry.outline

    @property
    def radius(self) -> float:
        """Hydraulic radius of the film in m: its radius if it is a disc.

        It is twice the area divided by the perimeter, the length by which estimates for a disc are
        applied to other films.
        """
        return self.outline.hydraulic_radius

    @property
    def reach(self) -> float:
        """Maximum distance of the rim from the film's centre, in m: the radius of a disc."""
        return self.outline.reach

    @property
    def bounds_mm(self) -> tuple[float, float, float, float]:
        """Minimum x, minimum y, maximum x and maximum y of the film in mm."""
        left, low = (1e3 * self.outline.lower_left).tolist()
        right, high = (-1e3 * self.outline.transform(-np.eye(2)).lower_left).tolist()
        return left, low, right, high

    def describe_outline(self) -> str:
        """Describe shape and size of the film, such as ``disc of 45 mm radius``."""
        if self.is_disc:
            return f"disc of {1e3 * self.radius:g} mm radius"
        left_mm, low_mm, right_mm, high_mm = self.bounds_mm
        return f"{self.shape} of {right_mm - left_mm:.4g} × {high_mm - low_mm:.4g} mm"

    @property
    def is_disc(self) -> bool:
        """Whether the film is a disc."""
        return self.shape == "circle"

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
        """Permittivity across the thickness at constant in-plane strain, in F/m."""
        from scipy.constants import epsilon_0  # imported here to read scenes without SciPy

        d = np.array([self.d31, self.d32, 0.0])
        return float(epsilon_0 * self.permittivity - d @ self.stiffness @ d)

    @property
    def reference_state(self) -> Film:
        """The film without warming and pressure: changes of charges are relative to its charges."""
        before = {"warming_K": None, "pressure_Pa": None, "pressure_follows": False}
        return self.model_copy(update=before)

    @property
    def weight(self) -> float:
        """Weight per area along z in Pa, without the weight of patches."""
        return self.density * self.thickness * (self.gravity_m_s2 or 0.0)

    @property
    def distributed_force(self) -> float:
        """Magnitude of the sum of pressure force and weight in N, without the patches' weight."""
        return float(abs((self.pressure_Pa or 0.0) + self.weight) * self.outline.area)

    @property
    def prestrain(self) -> NDArray[np.float64]:
        """Elastic strain (11, 22, 12) of the flat clamped film after warming, shape (3,).

        The shear is the engineering shear. The strain follows from the temperature change, or else
        from the pretension. Patches and the displacement of the rim are not included.
        """
        if self.temperature_change_K is not None:
            change = self.temperature_change_K + (self.warming_K or 0.0)
            strain = -self.thermal_expansion_per_K * change
            return strain * np.array([1.0, 1.0, 0.0]) + 0.0  # turn -0.0 into 0.0
        return np.asarray(np.linalg.solve(self.stiffness, self.prestress) + 0.0)

    @property
    def prestress(self) -> NDArray[np.float64]:
        """Stress (11, 22, 12) in Pa in the flat clamped film after warming, shape (3,).

        It may be compressive, as if the film did not wrinkle. Patches and the displacement of the
        rim are not included.
        """
        if self.pretension_N_m is None:
            return self.stiffness @ self.prestrain
        tension = np.append(np.broadcast_to(self.pretension_N_m, 2), 0.0)
        warming_strain = self.thermal_expansion_per_K * (self.warming_K or 0.0)
        relief = self.stiffness @ [warming_strain, warming_strain, 0.0]
        return np.asarray(tension / self.thickness - relief)

    @property
    def stiffness(self) -> NDArray[np.float64]:
        """Plane-stress stiffness in Pa in Voigt's notation (11, 22, 12), shape (3, 3)."""
        modulus = self.youngs_modulus_GPa
        E1, E2 = modulus if isinstance(modulus, tuple) else (modulus, modulus)
        return 1e9 * compute_plane_stress_stiffness(
            E1, E2, nu12=self.poisson_ratio, G=self.shear_modulus_GPa
        )

    @property
    def named_patches(self) -> dict[str, Patch]:
        """The patches by the names of their subdomains in a mesh."""
        return {f"film patch {i}": p for i, p in enumerate(self.patches or (), start=1)}

    @property
    def layers(self) -> dict[str, Layer]:
        """The materials of the patches that are layers, by the names of their subdomains."""
        patches = self.named_patches.items()
        return {name: self._make_layer(patch) for name, patch in patches if patch.thickness_um}

    def _make_layer(self, patch: Patch) -> Layer:
        """Make the layer of a patch; properties that the patch does not give are the film's."""
        stiffness = patch.compute_stiffness(self.stiffness)
        prestrain = self.reference_state.prestrain * (patch.bonded != "at rest")
        expansion = self.thermal_expansion_per_K
        if patch.thermal_expansion_per_K is not None:
            expansion = patch.thermal_expansion_per_K
            prestrain[:2] = -expansion * (self.temperature_change_K or 0.0)
        prestrain[:2] -= expansion * (self.warming_K or 0.0)
        density = self.density if patch.density_kg_m3 is None else patch.density_kg_m3
        return Layer(patch, stiffness, prestrain=prestrain, expansion=expansion, density=density)

    @property
    def has_unbalanced_prestress(self) -> bool:
        """Whether strained patches or a displaced rim deform the unloaded film in its plane."""
        is_layer_strained = any(layer.prestrain.any() for layer in self.layers.values())
        return is_layer_strained or self.rim_displacement_um is not None

    @property
    def is_flat_unloaded(self) -> bool:
        """Whether the film without probes is flat and undeformed in equilibrium.

        This is the case without strained patches, a displaced rim, pressure and weight.
        """
        return not (self.has_unbalanced_prestress or self.distributed_force)

    @property
    def is_inhomogeneous(self) -> bool:
        """Whether stiffness or prestrain vary over the film, by patches or a displaced rim."""
        return bool(self.patches or self.rim_displacement_um)

    def compute_rim_strain(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compute the strain of a smooth displacement field with `rim_displacement_um` at the rim.

        Parameters
        ----------
        points : ndarray, shape (..., 2)
            Points of the film in m.

        Returns
        -------
        ndarray, shape (..., 3)
            Linear strain (11, 22, 12) with engineering shear; zero if no displacement is given.

        Notes
        -----
        With lengths in units of the film's radius, the displacement at z = x + i y is g (x, y) with
        g = Re Σ_n C_n z^n and C_n = c_n - i s_n, where c_n and s_n are the coefficients of cos nθ
        and sin nθ in `rim_displacement_um`. On the rim g is the outward displacement.
        """
        x, y = np.moveaxis(points / self.radius, -1, 0)
        z = x + 1j * y
        constant, *others = self.rim_displacement_um or (0.0,)
        cosines = others[::2]
        sines = others[1::2]
        coefficients = [constant, *(c - 1j * s for c, s in zip(cosines, sines, strict=True))]
        strain = np.zeros((*points.shape[:-1], 3))
        for n, C in enumerate(np.array(coefficients) / 1e6 / self.radius):
            g = (C * z**n).real
            derivative = n * C * z ** max(n - 1, 0)
            g_x = derivative.real
            g_y = -derivative.imag
            strain += np.stack([g + x * g_x, g + y * g_y, x * g_y + y * g_x], axis=-1)
        return strain
