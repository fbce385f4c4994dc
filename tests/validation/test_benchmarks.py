"""The finite elements against closed forms and a one-dimensional solver of the round film.

The Foeppl-von Karman solutions hold for vanishing slopes, so the loads are as small as that:
at F/(E h a) of 1e-10 the slopes are about 1e-3, and their squares, by which the geometrically exact
film differs, move the deflection by less than 1e-8 and the tension by less than 1e-6. The problems
remain fully nonlinear.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.mesh.gmsh_mesh import mesh_scene
from pvdf_fem.mesh.size_field import Sizes
from pvdf_fem.solvers.status import Status
from reports.reference.axisymmetric import axisymmetric_membrane
from reports.reference.closed_form import campbell, hencky, linear_patch_deflection
from tests.helpers.discs import free_disc, uniform_mesh
from tests.helpers.solvers import newton_result

# F/(E h a) and p a/(E h) at which slopes vanish, and the scales of deflection and tension there.
SMALL = 1e-10
SLOPE = SMALL ** (1 / 3)
TENSION = SMALL ** (2 / 3)


@dataclass(frozen=True)
class RoundFilm:
    """A solved scene in scale-free terms: lengths in a, tensions in E h."""

    equilibrium: Equilibrium
    displacement: np.ndarray  # (dofs, 3), m

    @classmethod
    def solved(cls, scene, mesh):
        equilibrium = Equilibrium(scene, mesh)
        result = newton_result(equilibrium)
        assert result.status is Status.CONVERGED
        return cls(equilibrium, equilibrium.unknowns.expand(result.q).reshape(-1, 3))

    @property
    def radius(self):
        return self.equilibrium.film.radius

    @property
    def nodes(self):
        return self.equilibrium.space.basis.doflocs / self.radius

    @property
    def deflection(self):
        """Deflections of all nodes."""
        return self.displacement[:, 2] / self.radius

    @property
    def centre_deflection(self):
        """Deflection of the node on the centre."""
        distance = np.hypot(*self.nodes)
        assert distance.min() < 1e-12
        return self.deflection[distance.argmin()]

    @property
    def edge_tension(self):
        """Mean radial tension at the rim, from the reaction of the clamp in the plane.

        The reaction is that of the first Piola-Kirchhoff stress: the tension for small slopes.
        """
        membrane = self.equilibrium.membrane
        state = membrane.state(self.displacement.ravel())
        forces = membrane.internal_forces(state)
        rim = membrane.space.basis.get_dofs("rim").all()
        pull = (forces.reshape(-1, 3)[rim, :2] * self.nodes[:, rim].T).sum()
        film = membrane.film
        stiffness = film.youngs_modulus_GPa * 1e9 * film.thickness
        return pull / (2 * math.pi * self.radius * stiffness)

    def differs(self, profile):
        """Largest difference of the deflection from `profile(r/a)`, over that at the centre."""
        r = np.minimum(np.hypot(*self.nodes), 1.0)
        return np.abs(self.deflection - profile(r)).max() / self.centre_deflection


def patch_mesh(scene, refinement):
    """A mesh graded to the outlines, its sizes in proportion to the patches."""
    outline = scene.probe.outline
    sizes = {"probe": 0.4 * outline.radius, "electrode A": 0.08 * scene.film.radius}
    return mesh_scene(scene, Sizes(sizes, 0.3, 0.16 * scene.film.radius).scaled(refinement))


@pytest.mark.parametrize("poisson_ratio", [0.2, 0.3, 1 / 3, 0.4])
def test_hencky(poisson_ratio):
    """Uniform pressure without pretension; H. Hencky, Z. Math. Phys. 63 (1915) 311-317."""
    scene = free_disc(math.pi * SMALL, poisson_ratio=poisson_ratio)
    film = RoundFilm.solved(scene, uniform_mesh(scene, 2.5))
    exact = hencky(poisson_ratio)
    assert film.centre_deflection / SLOPE == pytest.approx(exact.centre_deflection, rel=1e-6)
    assert film.edge_tension / TENSION == pytest.approx(exact.edge_tension, rel=1e-5)
    assert film.differs(lambda r: SLOPE * exact.deflection(r)) < 1e-5


@pytest.mark.parametrize("pretension", [0.01, 0.1, 1.0, 10.0])
def test_campbell(pretension):
    """Uniform pressure with pretension; J. D. Campbell, Q. J. Mech. Appl. Math. 9 (1956) 84-93."""
    scene = free_disc(math.pi * SMALL, poisson_ratio=0.3, pretension=pretension * TENSION)
    film = RoundFilm.solved(scene, uniform_mesh(scene, 4.0))
    exact = campbell(pretension, 0.3)
    assert film.centre_deflection / SLOPE == pytest.approx(exact.centre_deflection, rel=1e-5)
    assert film.edge_tension / TENSION == pytest.approx(exact.edge_tension, rel=1e-5)


@pytest.mark.parametrize(
    ("kind", "pressure", "deflection"),
    [
        ("follower", 1e-3, 0.0654044),
        ("follower", 1e-2, 0.1413846),
        ("dead", 1e-3, 0.0653380),
        ("dead", 1e-2, 0.1407286),
    ],
)
def test_fichter(kind, pressure, deflection):
    """Uniform pressure at finite slopes; the problem of W. B. Fichter, NASA TP-3658 (1997).

    Digits of the project's reference values; `reports.reference.axisymmetric` gives more of them.
    """
    scene = free_disc(math.pi * pressure, poisson_ratio=0.3, **{"load.kind": kind})
    film = RoundFilm.solved(scene, uniform_mesh(scene, 4.0))
    exact = axisymmetric_membrane(math.pi * pressure, poisson_ratio=0.3, kind=kind)
    assert exact.centre_deflection == pytest.approx(deflection, abs=5e-8)
    assert film.centre_deflection == pytest.approx(exact.centre_deflection, rel=1e-5)


@pytest.mark.parametrize(
    ("radius_mm", "pretension", "deflection"),
    [(5, 0.0, 0.8643790), (5, 0.03, 0.8435545), (2, 0.03, 0.9022513)],
)
def test_circular_patch(radius_mm, pretension, deflection):
    """Uniform pressure on a central circle of a film of 45 mm, 1 N, Green-Lagrange strains.

    Digits of the project's reference values, W0 = w0/(F a^2/(E h))^(1/3).
    """
    force = 4.444e-4
    scene = free_disc(
        force,
        poisson_ratio=0.3,
        patch_radius=radius_mm / 45,
        pretension=pretension * force ** (2 / 3),
    )
    film = RoundFilm.solved(scene, patch_mesh(scene, 0.4))
    assert film.centre_deflection / force ** (1 / 3) == pytest.approx(deflection, rel=1e-5)


@pytest.mark.parametrize(
    ("radius_mm", "pretension", "deflection"),
    [(2, 0.0, 0.8681492), (5, 0.0, 0.7632369), (2, 0.03, 0.8476902), (5, 0.03, 0.7435842)],
)
def test_stuck_punch(radius_mm, pretension, deflection):
    """Rigid flat punch on a central circle; digits of the project's reference values."""
    scene = free_disc(
        SMALL,
        poisson_ratio=0.3,
        patch_radius=radius_mm / 45,
        pretension=pretension * TENSION,
        **{"load.kind": "rigid", "load.contact": "stuck"},
    )
    film = RoundFilm.solved(scene, patch_mesh(scene, 1.0))
    assert film.centre_deflection / SLOPE == pytest.approx(deflection, rel=1e-4)


@pytest.mark.parametrize("contact", ["sliding", "stuck"])
def test_punch_at_finite_slopes(contact):
    """Rigid flat punch at 1 N with Green-Lagrange strains, against `axisymmetric`."""
    force, punch = 4.444e-4, {"kind": "rigid", "contact": contact}
    shape = {"poisson_ratio": 0.34, "patch_radius": 0.1, "pretension": 1.7e-4}
    scene = free_disc(force, **shape, **{f"load.{key}": value for key, value in punch.items()})
    film = RoundFilm.solved(scene, patch_mesh(scene, 0.7))
    exact = axisymmetric_membrane(force, **shape, **punch)
    assert film.centre_deflection == pytest.approx(exact.centre_deflection, rel=1e-4)
    assert film.differs(exact.deflection) < 1e-4


def test_linear_off_centre_patch():
    """A tight film: Green's function of the disc, averaged over the patch, in every node."""
    scene = free_disc(
        1e-12, poisson_ratio=0.3, patch_radius=0.1, centre=(0.3, -0.2), pretension=1e-3
    )
    film = RoundFilm.solved(scene, patch_mesh(scene, 0.33))
    exact = linear_patch_deflection(
        film.nodes.T,
        centre=(0.3, -0.2),
        patch_radius=0.1,
        film_radius=1.0,
        force=1e-12,
        tension=1e-3,
    )
    assert np.abs(film.deflection - exact).max() < 1e-5 * exact.max()
