"""Proofs of deflections and tensions of the round film.

The Foeppl-von Karman solutions hold for vanishing slopes, so the loads are as small as that:
at F/(E h a) of 1e-10 the slopes are about 1e-3, and their squares, by which the geometrically exact
film differs, move the deflection by less than 1e-8 and the tension by less than 1e-6. The problems
remain fully nonlinear.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product
from types import SimpleNamespace

from pvdf_fem import Scene
from reports.reference.axisymmetric import axisymmetric_membrane
from reports.reference.closed_form import campbell, hencky, linear_patch_deflection, schwerin
from tests.validation.proof import Number, proof
from tests.validation.round_film import SLOPE, SMALL, TENSION, compared, disc, solved_to


@proof(
    "Uniform pressure without pretension",
    source="H. Hencky, Z. Math. Phys. 63 (1915) 311-317; his series summed to 14 digits",
    why="one mesh of some 1,000 cubic elements; the closed form is exact for vanishing slopes",
)
def without_pretension() -> Iterator[Number]:
    for nu in (0.2, 0.3, 0.4):
        film = disc(math.pi * SMALL, 3.0, poisson_ratio=nu)
        known = {"centre": 2e-6, "rim": 1e-5, "worst": 5e-5}
        yield from compared(f"ν = {nu}", film, hencky(nu), known, slope=SLOPE)


@proof(
    "A formula for the pressure",
    source="S. Komaragiri, M. R. Begley, J. G. Simmonds, J. Appl. Mech. 72 (2005) 203-212:"
    " w₀ = (0.7179 − 0.1706 ν − 0.1495 ν²) a (p a/(E h))^⅓",
    why="a parabola in ν that the authors fitted to the exact solution, up to 1e-3 from it",
)
def fitted() -> Iterator[Number]:
    for nu in (0.1, 0.25, 0.4):
        film = disc(math.pi * SMALL, poisson_ratio=nu)
        exact = SimpleNamespace(centre_deflection=0.7179 - 0.1706 * nu - 0.1495 * nu**2)
        yield from compared(f"ν = {nu}", film, exact, {"centre": 2e-3}, slope=SLOPE)


@proof(
    "Uniform pressure with pretension",
    source="J. D. Campbell, Q. J. Mech. Appl. Math. 9 (1956) 84-93; the series to 14 digits",
    why="one mesh; exact for vanishing slopes, from nearly slack to nearly linear films",
)
def with_pretension() -> Iterator[Number]:
    for n0 in (0.01, 0.1, 1.0, 10.0):
        film = disc(math.pi * SMALL, poisson_ratio=0.3, pretension=n0 * TENSION)
        known = {"centre": 1e-5, "rim": 1e-5}
        yield from compared(f"n₀ = {n0}", film, campbell(n0, 0.3), known, slope=SLOPE)


@proof(
    "Uniform pressure at finite slopes",
    source="the problem of W. B. Fichter, NASA TP-3658 (1997), by the project's spectral method"
    " in one dimension",
    why="one mesh; the same finite strains on both sides, deflections up to 0.14 a",
)
def finite_slopes() -> Iterator[Number]:
    for kind, p in product(("follower", "dead"), (1e-3, 1e-2)):
        film = disc(math.pi * p, poisson_ratio=0.3, **{"load.kind": kind})
        exact = axisymmetric_membrane(math.pi * p, poisson_ratio=0.3, kind=kind)
        yield from compared(f"{kind}, p a/(E h) = {p}", film, exact, {"centre": 1e-5})


@proof(
    "A soft film that bulges",
    source="Sensors 24 (2024) 5314, table A2: a = 70 mm, h = 0.3 mm, E = 3.05 MPa, ν = 0.45",
    why="the source is another theory of large deflections, up to 0.6 % from the exact one for"
    " deflections up to 0.41 a",
)
def soft_film() -> Iterator[Number]:
    film = {"radius_mm": 70.0, "thickness_um": 300.0, "youngs_modulus_GPa": 3.05e-3}
    film |= {"poisson_ratio": 0.45, "temperature_change_K": 0.0}
    scene = Scene().with_(film=film, probe={"shape": "circle", "radius_mm": 70.0})
    for kilopascal, deflection_mm in {0.5: 14.496, 1.0: 18.303, 2.0: 23.092, 4.0: 29.026}.items():
        force = 1e3 * kilopascal * math.pi * scene.film.radius**2
        found = solved_to(scene.with_(**{"load.force_N": force}), 1e-3).deflection_max_mm
        yield Number(f"deflection under {kilopascal} kPa (mm)", found, deflection_mm, 1.2e-2)


@proof(
    "A point load",
    source="E. Schwerin, Z. techn. Phys. (1929), in closed form",
    why="pressures on discs of 0.02 and 0.0025 a, extrapolated to a point: what differs goes with"
    " the radius to the power 2/3, and the next power is left",
)
def point_load() -> Iterator[Number]:
    for n0 in (0.0, 0.2):
        shape = {"poisson_ratio": 0.3, "pretension": n0 * TENSION}
        wide, narrow = (disc(SMALL, 1.0, **shape, patch_radius=b) for b in (2e-2, 2.5e-3))
        w = (4.0 * narrow.centre_deflection - wide.centre_deflection) / 3.0
        point = SimpleNamespace(centre_deflection=w, edge_tension=narrow.edge_tension)
        known = {"centre": 1e-4, "rim": 1e-4}
        yield from compared(f"n₀ = {n0}", point, schwerin(n0, 0.3), known, slope=SLOPE)


@proof(
    "A patch of pressure at the centre",
    source="the project's spectral method in one dimension, to 11 digits",
    why="one mesh; a film of 45 mm under 1 N, finite strains",
)
def patch() -> Iterator[Number]:
    force = 4.444e-4
    for radius_mm in (5, 2):
        shape = {"poisson_ratio": 0.3, "pretension": 0.03 * force ** (2 / 3)}
        shape["patch_radius"] = radius_mm / 45
        film, exact = disc(force, 0.5, **shape), axisymmetric_membrane(force, **shape)
        yield from compared(f"{radius_mm} mm", film, exact, {"centre": 3e-5})


@proof(
    "A rigid punch at the centre",
    source="the project's spectral method in one dimension, to 11 digits",
    why="the film kinks at the punch's edge; there elements lose their order",
)
def punch() -> Iterator[Number]:
    cases = [
        ("stuck", SMALL, radius, n0) for radius, n0 in ((2 / 45, 0.0), (0.1, 0.0), (0.1, 0.03))
    ]
    cases += [(contact, 4.444e-4, 0.1, 0.03) for contact in ("sliding", "stuck")]
    for contact, force, radius, n0 in cases:
        shape = {"poisson_ratio": 0.34, "patch_radius": radius}
        shape["pretension"] = n0 * force ** (2 / 3)
        rigid = {"load.kind": "rigid", "load.contact": contact}
        exact = axisymmetric_membrane(force, **shape, kind="rigid", contact=contact)
        case, known = f"{contact}, {radius:.2g} a, n₀ = {n0}", {"centre": 1e-4, "worst": 2e-4}
        yield from compared(case, disc(force, 0.7, **shape, **rigid), exact, known)


@proof(
    "A tight film under a patch off its centre",
    source="Green's function of the disc, averaged over the patch",
    why="one mesh; exact as the tension grows",
)
def off_centre() -> Iterator[Number]:
    shape = {"centre": (0.3, -0.2), "patch_radius": 0.1}
    film = disc(1e-12, 0.4, poisson_ratio=0.3, pretension=1e-3, **shape)
    exact = linear_patch_deflection(
        film.nodes.T, film_radius=1.0, force=1e-12, tension=1e-3, **shape
    )
    worst = abs(film.deflection - exact).argmax()
    quantity = "deflection where it differs most"
    yield Number(quantity, film.deflection[worst], exact[worst], 3e-5, float(exact.max()))
