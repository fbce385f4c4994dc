"""Proofs of charges: closed forms, problems in one dimension, and independent codes."""

from __future__ import annotations

import math
from collections.abc import Iterator

from pvdf_fem import Scene
from reports.accuracy.cases import compute_known_charges, read_cases
from tests.helpers.discs import LOADS, RECTANGLE, TRIANGLE
from tests.validation.proof import Number, proof
from tests.validation.round_film import solved_to

#: The accuracy report's cases. One sphere by shooting is enough.
CASES = [case for case in read_cases("cases.toml") if case.name != "sphere of 5 mm"]


def compared(
    case: str, scene: Scene, theirs: dict[str, float], tolerance: float, allowed: float = 0.0
) -> Iterator[Number]:
    """Charges of a solve beside those that are known, to its tolerance or what is allowed."""
    ours = solved_to(scene, tolerance).charges_pC
    for name, charge in theirs.items():
        yield Number(f"{case}, {name} (pC)", ours[name], charge, allowed or tolerance)


@proof(
    "Hencky's stress at the centre, from the charge of a small electrode",
    source="W. B. Fichter, NASA TP-3658 (1997): σ/(E p² a²/h²)^⅓ = b₀/4",
    why="five digits are printed, and the electrode has 1 % of the film's radius; textbooks with"
    " 0.423 at ν = 0.25 repeat an old slip of arithmetic of 0.6 %",
)
def stress_at_the_centre() -> Iterator[Number]:
    for nu, printed in ((0.2, 0.42068), (0.3, 0.43110), (0.4, 0.44423)):
        film = {"poisson_ratio": nu, "temperature_change_K": 0.0}
        disc = [{"name": "A", "shape": "circle", "radius_mm": 0.45, "x_mm": 0.0, "y_mm": 0.0}]
        probe = {"shape": "circle", "radius_mm": 45.0}
        scene = Scene().with_(film=film, electrodes=disc, probe=probe, load={"force_N": 1e-6})
        charge = solved_to(scene, 1e-5).charges_pC["A"]
        a, h, E = scene.film.radius, scene.film.thickness, 2e9
        area = math.pi * 0.45e-3**2
        stress = 1e-12 * charge / (scene.film.d31 + scene.film.d32) / area
        p = scene.load.force / (math.pi * a**2)
        unit = (E * (p * a / h) ** 2) ** (1 / 3)
        yield Number(f"b₀/4, ν = {nu}", stress / unit, printed, 1e-4)


@proof(
    "Closed forms and problems in one dimension",
    source="the series of Hencky and Campbell; films, punches and wrinkled films by spectral"
    " elements and shooting; von Kármán's plate; a sphere that slides (`reports/reference/`)",
    why="the tolerance of the solve: 1e-4",
)
def one_dimension() -> Iterator[Number]:
    for case in CASES:
        if case.truth not in ("codes", "finer"):
            known = compute_known_charges(case.truth, case.scene)
            yield from compared(case.name, case.scene, known, max(case.finest, 1e-4))


@proof(
    "Independent codes",
    source="computed for this project by two other codes that agree to 1e-7",
    why="the tolerance of the solve: 1e-3, which is the default, and 1e-5",
)
def codes() -> Iterator[Number]:
    for case in CASES:
        if case.truth == "codes":
            for tolerance in (1e-3, 1e-5):
                yield from compared(case.name, case.scene, case.charges_pC, tolerance)


@proof(
    "Follower pressures and rigid faces",
    source="an independent code; five digits under a pressure, three under a punch",
    why="half a unit of the last printed digit and the tolerance; the corners of a rigid face make"
    " any code slow to converge",
)
def other_loads() -> Iterator[Number]:
    followers = {0.25: (324.57, 313.83), 1.0: (800.72, 770.88), 7.5: (3061.37, 2939.68)}
    for force, (A, B) in followers.items():
        scene = RECTANGLE.with_(**LOADS["follower"], **{"load.force_N": force})
        yield from compared(f"follower, {force} N", scene, {"A": A, "B": B}, 1e-5, 4e-5)
    for contact, A, B, triangle in (
        ("sliding", 895.0, 741.0, 1392.0),
        ("stuck", 873.0, 623.0, 1485.0),
    ):
        long, three = (scene.with_(**LOADS[contact]) for scene in (RECTANGLE, TRIANGLE))
        yield from compared(f"rectangle, {contact}", long, {"A": A, "B": B}, 1e-3, 2e-3)
        yield from compared(f"triangle, {contact}", three, {"A": triangle}, 1e-3, 8e-3)


@proof(
    "Pretension alone",
    source="(d₃₁ + d₃₂) E α |ΔT|/(1 − ν) times the electrode's area",
    why="nothing but rounding",
)
def pretension() -> Iterator[Number]:
    for observable in ("material", "thesis-edge"):
        for what, scene in (("no probe", Scene()), ("no force", RECTANGLE)):
            changes = {"numerics.observable": observable}
            changes |= {"load.force_N": 0.0} if scene.probe else {}
            case = f"{observable}, {what}"
            yield from compared(case, scene.with_(**changes), {"A": 48.0}, 1e-3, 1e-10)
