"""Solves on a half or a quarter of a symmetric film, against those on the whole of it."""

import numpy as np
import pytest

from pvdf_fem import Scene, solve
from pvdf_fem.electrodes.stress_integrals import compute_stress_integrals, differentiate_charges
from pvdf_fem.mesh.gmsh_mesh import mesh_scene
from pvdf_fem.mesh.subdomains import RIM
from pvdf_fem.mesh.symmetry import WHOLE_FILM
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.outputs import Output
from pvdf_fem.problem.problem import Problem
from pvdf_fem.problem.symmetry import find_symmetry_sector
from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.polygon import Polygon
from pvdf_fem.solver.first_sizes import choose_first_sizes
from pvdf_fem.solver.history import StageTimer
from pvdf_fem.solver.mesh_level import SolveRun, solve_on_mesh
from pvdf_fem.solver.nonlinear.budget import Budget
from tests.helpers.discs import LOADS, RECTANGLE, TRIANGLE

EDGES = {"numerics.observable": "thesis-edge"}
DISC = RECTANGLE.with_(**{"probe.shape": "circle", "probe.radius_mm": 2.0})
# A touches the line x = 0, as its image B does; C lies across it.
TOUCHING = RECTANGLE.with_(
    electrodes=[
        {"name": "A", "x_mm": 1.5, "y_mm": 9.0},
        {"name": "B", "x_mm": -1.5, "y_mm": 9.0},
        {"name": "C", "x_mm": 0.0, "y_mm": -8.0},
    ]
)
# The mesh follows the images of electrodes too, which are none of the scene's.
ANYWHERE = DISC.with_(**{"probe.x_mm": 5.0, "probe.y_mm": 2.5, "numerics.tolerance": 1e-4})
PUSHED = {"load.tangential_N": [0.6, 0.0]}
PAIR = [{"shape": "circle", "radius_mm": 2.0, "x_mm": x_mm, "force_N": 0.5} for x_mm in (6.0, -6.0)]
HALVES = {
    "triangle on the y axis": TRIANGLE.with_(**{"probe.x_mm": 0.0, "probe.y_mm": 5.0}),
    "triangle at the centre, three electrodes": TRIANGLE.with_(
        **{"probe.x_mm": 0.0, "probe.y_mm": 0.0, "electrodes.layout": "three"}
    ),
    "disc on the diagonal": DISC.with_(**{"probe.x_mm": -4.0, "probe.y_mm": 4.0}),
    "disc anywhere, electrodes nearly on their images": ANYWHERE.with_(**{"probe.y_mm": 1e-3}),
    "edges on the mirror line": TOUCHING,
    "means along them": TOUCHING.with_(**EDGES),
    "pushed": DISC.with_(**{"probe.x_mm": -7.0}, **PUSHED),
    "pushed pair": Scene(probe=PAIR, load={"tangential_N": [0.0, 0.6]}),
    "uneven pair": Scene(probe=PAIR).with_(**{"probe[0].force_N": 0.6}),
}
QUARTERS = {
    "rectangle": RECTANGLE,
    "unequal tensions": RECTANGLE.with_(**{"film.pretension_N_m": [12.0, 5.0]}),
    "rectangle at 45 degrees": RECTANGLE.with_(**{"probe.rotation_deg": 45.0}),
    "pair": Scene(probe=PAIR),
    "stiff along y": RECTANGLE.with_(**{"film.youngs_modulus_GPa": [2.0, 3.0]}),
    "follower": RECTANGLE.with_(**LOADS["follower"]),
    "stuck": RECTANGLE.with_(**LOADS["stuck"]),
    "wrinkling": RECTANGLE.with_(
        **{"film.compression": "tension-field", "film.temperature_change_K": 2.0}
    ),
}
SYMMETRIC = HALVES | QUARTERS
OTHERS = {
    "triangle beside an axis": TRIANGLE,
    "nearly": RECTANGLE.with_(**{"probe.x_mm": 45e-6, "probe.y_mm": 45e-6}),
    "one electrode smaller": RECTANGLE.with_(
        electrodes=[
            {"name": "A", "x_mm": 10.0, "y_mm": 4.0, "side_mm": 3.0},
            {"name": "B", "x_mm": -10.0, "y_mm": 4.0, "side_mm": 3.001},
        ]
    ),
    "rectangle at 45 degrees, stiff along x": RECTANGLE.with_(
        **{"probe.rotation_deg": 45.0, "film.youngs_modulus_GPa": [3.0, 2.0]}
    ),
    "disc anywhere, where a coarse mesh will do": ANYWHERE.with_(**{"numerics.tolerance": 1e-3}),
    "nothing presses": RECTANGLE.with_(**{"load.force_N": 0.0}),
}


def solve_sector(scene):
    """The solution on the first mesh of a part of the film."""
    part, order = find_symmetry_sector(scene), 3
    mesh = mesh_scene(scene, choose_first_sizes(Problem.from_scene(scene), order), part)
    problem = Problem.from_scene(scene)
    run = SolveRun(problem, Budget.for_problem(problem), timer=StageTimer())
    return solve_on_mesh(run, Equilibrium(problem, mesh, order, sector=part)).discrete


@pytest.mark.parametrize("name", OTHERS)
def test_asymmetric_scenes_have_no_sector(name):
    assert find_symmetry_sector(OTHERS[name]) is WHOLE_FILM


def test_bending_films_are_solved_on_the_whole_film():
    scene = RECTANGLE.with_(**{"film.bending": True})
    assert find_symmetry_sector(scene).mirror_axes
    assert solve(scene).discrete.solved.sector is WHOLE_FILM


@pytest.mark.parametrize("name", SYMMETRIC)
def test_an_unfolded_solution_is_in_equilibrium_on_the_whole_film(name):
    scene, part = SYMMETRIC[name], find_symmetry_sector(SYMMETRIC[name])
    assert len(part.signs) == (2 if name in HALVES else 4)
    assert part.frame @ part.frame.T == pytest.approx(np.eye(2), abs=1e-15)
    fields = solve_sector(scene)
    whole, mesh = fields.equilibrium, fields.equilibrium.space.mesh
    assert mesh.nelements == len(fields.solved.sector.signs) * fields.solved.space.mesh.nelements
    areas = whole.membrane.space.weights
    assert areas.sum() == pytest.approx(np.pi * scene.film.radius**2, rel=1e-12)
    for electrode in scene.electrode_list:
        patch = mesh.subdomains[f"electrode {electrode.name}"]
        assert areas[patch].sum() == pytest.approx(electrode.outline.area, rel=1e-12)
        centre = mesh.p[:, mesh.t[:, patch]].mean(axis=(1, 2))
        assert np.linalg.norm(centre - electrode.outline.centroid) < 1e-3
    assert np.array_equal(np.sort(mesh.boundaries[RIM]), np.sort(mesh.boundary_facets()))
    held = whole.unknowns.expand(whole.unknowns.restrict(fields.displacement))
    assert held == pytest.approx(fields.displacement, abs=1e-15)
    assert np.abs(whole.residual(fields.state)).max() < 1e-9 * scene.load.force
    forces = compute_stress_integrals(
        Problem.from_scene(scene).outputs, whole.membrane, fields.displacement
    )
    limit = 1e-11 * np.abs(forces).max()
    assert fields.stress_integrals.values == pytest.approx(forces, rel=1e-11, abs=limit)
    for name in ("rim_reaction", "applied_force"):
        of_part = getattr(fields.solved, name)(fields.solved_state)
        of_whole = getattr(whole, name)(fields.state)
        assert of_part == pytest.approx(of_whole, rel=1e-11, abs=1e-9 * scene.load.force)


@pytest.mark.parametrize("name", ["disc on the diagonal", "edges on the mirror line", "rectangle"])
@pytest.mark.parametrize("observable", ["material", "thesis-edge"])
def test_charges_on_a_sector_equal_those_on_the_whole_film(name, observable):
    fields = solve_sector(SYMMETRIC[name])
    turn = np.array([[0.6, 0.8], [-0.8, 0.6]])
    square = 1e-3 * np.array([[-3.0, -2.0], [4.0, -2.0], [4.0, 6.0], [-3.0, 6.0]])
    shapes = [Polygon(square), Polygon(np.add(square, [6e-3, 1e-3]))]
    if observable == "material":
        shapes.append(Circle([-1e-3, 2e-3], 4e-3))
    outputs = [Output(shape, observable, (1.0, 1.0), None, turn) for shape in shapes]
    whole = compute_stress_integrals(outputs, fields.equilibrium.membrane, fields.displacement)
    assert fields.integrals_of(outputs) == pytest.approx(whole, rel=1e-6)


@pytest.mark.parametrize("name", ["means along them", "rectangle at 45 degrees"])
def test_gradients_on_a_sector_equal_those_on_the_whole_film(name):
    scene = SYMMETRIC[name]
    fields, outputs = solve_sector(scene), Problem.from_scene(scene).outputs
    membrane, part, x = fields.solved.membrane, fields.solved.sector, fields.solved_dofs
    step = 1e-7 * np.random.default_rng(1).standard_normal(len(x))

    def values(x):
        return compute_stress_integrals(outputs, membrane, x, sector=part) @ [
            scene.film.d31,
            scene.film.d32,
        ]

    slopes = differentiate_charges(outputs, membrane, x, sector=part).T @ step
    assert 0.5 * (values(x + step) - values(x - step)) == pytest.approx(slopes, rel=1e-6)
