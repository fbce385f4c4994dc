"""What must hold for every scene: symmetries, similarity, equilibrium, honest error estimates."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from pvdf_fem import Scene, solve
from pvdf_fem.scene.outlines.outline import turn
from pvdf_fem.solvers.status import Status
from reports.accuracy.drawn import KINDS, drawn_scenes
from tests.helpers.damage import drawn
from tests.helpers.discs import LOADS, RECTANGLE, TRIANGLE

few = drawn(0.05)
places = st.tuples(st.floats(-12, 12), st.floats(-12, 12))
angles = st.floats(-180, 180)
forces = st.floats(0.01, 50)


@st.composite
def probes(draw):
    """Probes of the thesis's sizes anywhere near the electrodes."""
    shape = draw(
        st.sampled_from(
            [
                {"shape": "triangle", "side_mm": 7.0},
                {"shape": "rectangle", "width_mm": 14.0, "height_mm": 7.0},
                {"shape": "circle", "radius_mm": 3.0},
            ]
        )
    )
    x, y = draw(places)
    return shape | {"x_mm": x, "y_mm": y, "rotation_deg": draw(angles)}


def scene_with(probe, **changes):
    return Scene().with_(probe=probe, **changes)


def values(by_name):
    return np.array(list(by_name.values()))


def turned(scene, angle):
    """The scene with probe and electrodes turned about the film's centre."""

    def place(shape):
        x, y = turn([shape.x_mm, shape.y_mm], angle)
        return {"x_mm": x, "y_mm": y, "rotation_deg": shape.rotation_deg + angle}

    return scene.with_(
        electrodes=[e.model_dump() | place(e) for e in scene.electrode_list],
        probe=scene.probe.model_dump() | place(scene.probe),
    )


@given(probe=probes(), force_N=forces, angle=angles)
@few
def test_turning_probe_and_electrodes_changes_no_charge(probe, force_N, angle):
    scene = scene_with(probe, **{"load.force_N": force_N})
    charges = solve(scene).charges_pC
    assert solve(turned(scene, angle)).charges_pC == pytest.approx(
        charges, rel=scene.numerics.tolerance
    )


@given(probe=probes(), force_N=forces)
@few
def test_mirrored_probes_exchange_the_electrodes(probe, force_N):
    mirrored = probe | {"x_mm": -probe["x_mm"], "rotation_deg": -probe["rotation_deg"]}
    scene, image = (scene_with(p, **{"load.force_N": force_N}) for p in (probe, mirrored))
    charges, swapped = solve(scene).charges_pC, solve(image).charges_pC
    expected = {name: charges[other] for name, other in zip("ABCD", "CBAD", strict=True)}
    assert swapped == pytest.approx(expected, rel=scene.numerics.tolerance)


@given(
    probe=probes(),
    force_N=forces,
    factor=st.floats(0.2, 5),
    kind=st.sampled_from(list(LOADS)),
)
@few
def test_only_force_over_thickness_matters(probe, force_N, factor, kind):
    """Same stresses, so the same charges and deflections, on the same mesh."""
    thin = scene_with(probe, **{"load.force_N": force_N, "film.thickness_um": 25.0}, **LOADS[kind])
    thick = thin.with_(**{"load.force_N": force_N * factor, "film.thickness_um": 25.0 * factor})
    expected = solve(thin)
    assume(expected.status is not Status.UNSTABLE)  # a stuck punch can compress the film
    scaled = solve(thick, mesh=expected.mesh)
    assert scaled.charges_pC == pytest.approx(expected.charges_pC, rel=1e-7)
    assert scaled.deflection_max_mm == pytest.approx(expected.deflection_max_mm, rel=1e-7)


@given(probe=probes(), force_N=forces, kind=st.sampled_from(["dead", "sliding", "stuck"]))
@few
def test_rim_bears_the_force(probe, force_N, kind):
    solution = solve(scene_with(probe, **{"load.force_N": force_N}, **LOADS[kind]))
    equilibrium, state = solution.fields.equilibrium, solution.fields.state
    assert equilibrium.applied_force(state)[2] == pytest.approx(force_N, rel=1e-12)
    assert equilibrium.rim_reaction(state)[2] == pytest.approx(-force_N, rel=1e-6)
    assert solution.force_balance < 1e-6


@given(probe=probes(), force_N=forces)
@few
def test_rim_bears_the_vertical_part_of_a_follower_pressure(probe, force_N):
    solution = solve(scene_with(probe, **{"load.force_N": force_N}, **LOADS["follower"]))
    assert solution.force_balance < 1e-6
    # the probe's part of the film is stretched and tilted: the resultant is not F
    applied = solution.fields.equilibrium.applied_force(solution.fields.state)
    assert applied[2] == pytest.approx(force_N, rel=0.1)


@given(probe=probes(), kind=st.sampled_from(list(LOADS)))
@few
def test_power_laws_without_pretension(probe, kind):
    """w ~ F^(1/3) and Q ~ F^(2/3) while slopes vanish."""
    scene = scene_with(probe, **{"film.temperature_change_K": 0.0}, **LOADS[kind])
    weak, strong = (solve(scene.with_(**{"load.force_N": f})) for f in (1e-8, 8e-8))
    assert strong.deflection_max_mm / weak.deflection_max_mm == pytest.approx(2, rel=1e-5)
    assert values(strong.charges_pC) / values(weak.charges_pC) == pytest.approx(4, rel=1e-4)


@given(probe=probes(), force_N=forces)
@few
def test_force_raises_every_charge_of_an_isotropic_film(probe, force_N):
    """A dead load only adds tension: no charge falls below the 48 pC of the pretension."""
    assert values(solve(scene_with(probe, **{"load.force_N": force_N})).charges_pC).min() > 48.0


ESTIMATED = {
    "rectangle": RECTANGLE,
    "triangle": TRIANGLE,
    "follower": TRIANGLE.with_(**LOADS["follower"]),
    "orthotropic": TRIANGLE.with_(
        **{"film.youngs_modulus_GPa": [3.0, 1.5], "film.d31_pC_N": 18.0, "film.d32_pC_N": 2.0}
    ),
    "edges": RECTANGLE.with_(**{"numerics.observable": "thesis-edge"}),
    "stuck": RECTANGLE.with_(**LOADS["stuck"]),
    "sliding": RECTANGLE.with_(**LOADS["sliding"]),
}


@pytest.mark.parametrize("case", ESTIMATED)
def test_error_estimates_are_honest(case):
    """The worst charge meets the tolerance, and its stated error is 0.3 to 3 times the true one."""
    scene = ESTIMATED[case]
    solution = solve(scene)
    exact = values(solve(scene.with_(**{"numerics.tolerance": 3e-5})).charges_pC)
    errors = np.abs(values(solution.charges_pC) - exact)
    estimates = values(solution.charge_errors_pC)
    worst = np.argmax(errors / exact)
    assert errors[worst] <= scene.numerics.tolerance * exact[worst]
    assert 0.3 < estimates[worst] / errors[worst] < 3


@pytest.mark.parametrize("kind", KINDS)
def test_stated_errors_cover_true_ones_in_drawn_scenes(kind):
    """Against ten times finer solves; charges whose parts cancel have a warning, and no tolerance
    of their own."""
    for scene in drawn_scenes(kind, 1, seed=5):
        coarse = scene.with_(**{"numerics.tolerance": 3e-3})
        solution, fine = (solve(s) for s in (coarse, scene.with_(**{"numerics.tolerance": 3e-4})))
        exact, stated = values(fine.charges_pC), values(solution.charge_errors_pC)
        errors = np.abs(values(solution.charges_pC) - exact)
        told = errors > 2.0 * values(fine.charge_errors_pC)
        assert (stated > 0.2 * errors)[told].all()
        warned = " ".join(solution.warnings)
        plain = [f"charge {name}:" not in warned for name in fine.charges_pC]
        assert (errors <= 1.3 * 3e-3 * np.abs(exact))[plain].all()
