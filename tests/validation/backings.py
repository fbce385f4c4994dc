"""Proofs of films on an elastic backing: deflections and frequencies of a stretched disc.

A disc of the radius a under the tension N, on a backing of the stiffness k, obeys
N ∇²w - k w + p = 0 as long as the deflection w leaves the tension as it is. With κ = √(k/N), what
is round about its centre is a sum of the modified Bessel functions I₀(κ r) and K₀(κ r).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.special import i0, i1, jn_zeros, k0, k1

from pvdf_fem import Scene, modes, solve
from tests.validation.proof import Number, proof

#: The default film: its radius in m, and its tension in N/m.
RADIUS = Scene().film.radius
TENSION = float(Scene().film.prestress[0]) * Scene().film.thickness
#: Stiffnesses k in N/m³, of which the decay lengths √(N/k) are 29, 9 and 3 mm.
STIFFNESSES = (1e4, 1e5, 1e6)
#: Deflections at the centre divided by the radius. They change the tension by less than 1e-6.
SMALL = 1e-5


def deflect(changes: dict[str, Any], radius: float = 0.0) -> float:
    """Return the deflection in m at the distance `radius` in m from the centre of the film."""
    scene = Scene().with_(**{"numerics.tolerance": 1e-5, **changes})
    return 1e-3 * float(solve(scene).at(1e3 * radius, 0.0).deflection_mm)


def press(force: float, radius: float) -> dict[str, Any]:
    """Return the changes of a scene by which a force presses on a disc at the centre."""
    probe = {"shape": "circle", "radius_mm": 1e3 * radius, "x_mm": 0.0, "y_mm": 0.0}
    return {"probe": probe, "load.force_N": force}


def deflect_under_disc(kappa: float, b: float, r: float = 0.0) -> float:
    """Return 2π N w/F under a force on a disc of the radius b, for r = 0 and r at least b."""
    by_rim = k0(kappa * RADIUS) / i0(kappa * RADIUS)
    x = kappa * b
    if r == 0.0:
        return float(2.0 / x**2 * (1.0 - x * k1(x) - by_rim * x * i1(x)))
    return float(2.0 * i1(x) / x * (k0(kappa * r) - by_rim * i0(kappa * r)))


@proof(
    "A disc of pressure on a backed film",
    source="N ∇²w - k w + p = 0 in modified Bessel functions",
    why="the mesh is chosen for the charges, in which deflections of 1e-5 a have hardly a part;"
    " differences are relative to the deflection at the centre",
)
def disc_of_pressure() -> Iterator[Number]:
    for k in STIFFNESSES:
        kappa = np.sqrt(k / TENSION)
        for b in (2e-3, 10e-3):
            unit = deflect_under_disc(kappa, b)
            force = 2.0 * np.pi * TENSION * SMALL * RADIUS / unit
            changes = press(force, b) | {"film.backing_N_m3": k}
            for r in (0.0, 15e-3):
                theirs = force * deflect_under_disc(kappa, b, r) / (2.0 * np.pi * TENSION)
                name = f"deflection at {1e3 * r:g} mm, k = {k:g} N/m³, b = {1e3 * b:g} mm (m)"
                yield Number(name, deflect(changes, r), theirs, 1e-4, size=SMALL * RADIUS)


@proof(
    "A point load on a backed film",
    source="w = F/(2π N) (K₀(κ r) - I₀(κ r) K₀(κ a)/I₀(κ a)), the fundamental solution",
    why="pressed on a disc of 0.2 mm, which outside of it acts as a point load up to"
    " (κ b)²/8 = 6e-4 at the stiffest backing",
)
def point_load() -> Iterator[Number]:
    for k in STIFFNESSES:
        kappa = np.sqrt(k / TENSION)
        force = 2.0 * np.pi * TENSION * SMALL * RADIUS
        changes = press(force, 2e-4) | {"film.backing_N_m3": k}
        for r in (3e-3, 15e-3):
            by_rim = k0(kappa * RADIUS) / i0(kappa * RADIUS)
            theirs = SMALL * RADIUS * (k0(kappa * r) - by_rim * i0(kappa * r))
            name = f"deflection at {1e3 * r:g} mm, k = {k:g} N/m³ (m)"
            yield Number(name, deflect(changes, r), float(theirs), 1e-3)


@proof(
    "A backing of a part of the film",
    source="the same equation on a backed disc, Poisson's equation on the ring around it, joined",
    why="the mesh is chosen for the charges, in which deflections of 1e-5 a have hardly a part",
)
def part() -> Iterator[Number]:
    edge = 12e-3
    for k in STIFFNESSES:
        x = np.sqrt(k / TENSION) * edge
        pressure = 4.0 * TENSION * SMALL / RADIUS
        # w = p/k + A I₀(κ r) inside, (p (a² - r²)/4 + C ln(r/a))/N outside
        inside = [i0(x), -np.log(edge / RADIUS) / TENSION]
        slopes = [x * i1(x), -1.0 / TENSION]
        of_pressure = pressure / (4.0 * TENSION)
        values = [
            of_pressure * (RADIUS**2 - edge**2) - pressure / k,
            -2.0 * of_pressure * edge**2,
        ]
        amplitude, _ = np.linalg.solve([inside, slopes], values)
        patch = {"shape": "circle", "radius_mm": 1e3 * edge, "x_mm": 0.0, "y_mm": 0.0}
        backed = [{**patch, "backing_N_m3": k}]
        ours = deflect({"film.pressure_Pa": pressure, "film.patches": backed})
        yield Number(f"deflection, k = {k:g} N/m³ (m)", ours, float(pressure / k + amplitude), 2e-4)


def find_lift_off(pressure: float, suction: float, kappa: float) -> tuple[float, float]:
    """Return where a film lifts off a one-sided backing, and its deflection at the centre, in m.

    A pressure acts on a disc of 5 mm at the centre, against a suction on the whole film.
    """
    b = 5e-3
    k = kappa**2 * TENSION

    def join(edge: float) -> tuple[float, float]:
        """Return slope times r beyond an edge minus that before, and the deflection at 0."""
        x, y = kappa * b, kappa * edge
        # before the edge: (p - q)/k + A I₀ below the disc, -q/k + B I₀ + C K₀ beside it, w = 0 at
        # the edge; by the Wronskian the pressure contributes p/k κ b (I₁ K₀, -K₁ I₀)
        step = pressure / k * x
        outer = step * i1(x)
        inner = (suction / k - outer * k0(y)) / i0(y)
        slope = y * (inner * i1(y) - outer * k1(y))
        centre = (pressure - suction) / k + inner - step * k1(x)
        # beyond it N ∇²w = q with w = 0 at the edge and at the rim
        logarithm = -suction * (RADIUS**2 - edge**2) / (4.0 * TENSION * np.log(RADIUS / edge))
        beyond = suction * edge**2 / (2.0 * TENSION) + logarithm
        return float(beyond - slope), float(centre)

    edge = brentq(lambda r: join(r)[0], 1.05 * b, 0.95 * RADIUS)
    return float(edge), join(edge)[1]


@proof(
    "A film that lifts off a one-sided backing",
    source="Bessel functions up to the edge of the contact, a logarithm beyond it; at the edge"
    " of the contact the slopes agree",
    why="the edge of the contact runs through elements of a mesh that does not follow it",
)
def lift_off() -> Iterator[Number]:
    for k in STIFFNESSES[:2]:
        kappa = float(np.sqrt(k / TENSION))
        suction = 4.0 * TENSION * SMALL / RADIUS
        pressure = 60.0 * suction
        edge, theirs = find_lift_off(pressure, suction, kappa)
        changes = press(pressure * np.pi * 5e-3**2, 5e-3)
        changes["film"] = {
            "backing_N_m3": k,
            "backing_one_sided": True,
            "pressure_Pa": -suction,
        }
        name = f"deflection, k = {k:g} N/m³, contact to {1e3 * edge:.1f} mm (m)"
        yield Number(name, deflect(changes), theirs, 5e-5)


@proof(
    "A sphere on a backed film",
    source="the film follows the sphere up to the edge of the contact, where the slopes agree;"
    " beside it, modified Bessel functions",
    why="a penalty on the overlap, and a contact whose edge runs through elements; slopes of 5e-3"
    " under a tension that they hardly change",
)
def sphere() -> Iterator[Number]:
    tension = 1e4
    sphere_radius = 40e-3
    edge = 2e-4
    for k in (1e7, 1e9):
        kappa = np.sqrt(k / tension)
        by_rim = k0(kappa * RADIUS) / i0(kappa * RADIUS)
        beside = k0(kappa * edge) - by_rim * i0(kappa * edge)
        slope = -kappa * (k1(kappa * edge) + by_rim * i1(kappa * edge))
        depth = edge**2 / (2.0 * sphere_radius) - edge / sphere_radius * beside / slope
        borne = k * np.pi * (depth * edge**2 - edge**4 / (4.0 * sphere_radius))
        force = float(borne + 2.0 * np.pi * tension * edge**2 / sphere_radius)
        probe = {"shape": "sphere", "radius_mm": 1e3 * sphere_radius, "x_mm": 0.0, "y_mm": 0.0}
        film = {"pretension_N_m": tension, "backing_N_m3": k}
        load = {"kind": "contact", "force_N": force}
        scene = Scene(film=film, probe=probe, load=load, numerics={"tolerance": 1e-4})
        [contact] = solve(scene).contacts.values()
        yield Number(f"depth, k = {k:g} N/m³ (mm)", contact.depth_mm, float(1e3 * depth), 2e-4)


@proof(
    "Vibrations of a backed disc",
    source="ω² = (N (j/a)² + k)/(ρ h) with the zeros j of J₀ and J₁",
    why="the tolerance of the solve",
)
def vibrations() -> Iterator[Number]:
    film = Scene().film
    mass = film.density * film.thickness
    for k in STIFFNESSES:
        scene = Scene().with_(**{"film.backing_N_m3": k, "numerics.tolerance": 1e-4})
        ours = modes(scene, 2).frequencies_Hz
        for order in (0, 1):
            j = jn_zeros(order, 1)[0]
            theirs = np.sqrt((TENSION * (j / RADIUS) ** 2 + k) / mass) / (2.0 * np.pi)
            name = f"frequency, zero of J{order}, k = {k:g} N/m³ (Hz)"
            yield Number(name, float(ours[order]), float(theirs), 1e-4)
