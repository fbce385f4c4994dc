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
from tests.helpers.discs import LOADS

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


@given(probe=probes(), force_N=forces, kind=st.sampled_from(list(LOADS)))
@few
def test_rim_bears_the_force(probe, force_N, kind):
    """A follower's resultant is not F, as the film under the probe is stretched and tilted."""
    solution = solve(scene_with(probe, **{"load.force_N": force_N}, **LOADS[kind]))
    equilibrium, state = solution.fields.equilibrium, solution.fields.state
    applied = equilibrium.applied_force(state)[2]
    assert applied == pytest.approx(force_N, rel=0.1 if kind == "follower" else 1e-12)
    assert equilibrium.rim_reaction(state)[2] == pytest.approx(-applied, rel=1e-6)
    assert solution.force_balance < 1e-6
    if kind == "dead":  # which only adds tension to the 48 pC of the pretension
        assert values(solution.charges_pC).min() > 48.0


@given(probe=probes(), kind=st.sampled_from(list(LOADS)))
@few
def test_power_laws_without_pretension(probe, kind):
    """w ~ F^(1/3) and Q ~ F^(2/3) while slopes vanish."""
    scene = scene_with(probe, **{"film.temperature_change_K": 0.0}, **LOADS[kind])
    weak, strong = (solve(scene.with_(**{"load.force_N": f})) for f in (1e-8, 8e-8))
    assert strong.deflection_max_mm / weak.deflection_max_mm == pytest.approx(2, rel=1e-5)
    assert values(strong.charges_pC) / values(weak.charges_pC) == pytest.approx(4, rel=1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_stated_errors_cover_true_ones_in_drawn_scenes(kind):
    """Against ten times finer solves; charges whose parts cancel have a warning, and no tolerance
    of their own."""
    (scene,) = drawn_scenes(kind, 1, seed=5)
    solution, fine = (solve(scene.with_(**{"numerics.tolerance": t})) for t in (3e-3, 3e-4))
    exact, stated = values(fine.charges_pC), values(solution.charge_errors_pC)
    errors = np.abs(values(solution.charges_pC) - exact)
    told = errors > 2.0 * values(fine.charge_errors_pC)
    assert (stated > 0.2 * errors)[told].all()
    assert stated.max() < 10.0 * errors.max() + 3.0 * values(fine.charge_errors_pC).max()
    warned = " ".join(solution.warnings)
    plain = [f"charge {name}:" not in warned for name in fine.charges_pC]
    assert (errors <= 1.3 * 3e-3 * np.abs(exact))[plain].all()
