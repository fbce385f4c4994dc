"""Scenes that are refused: each mistake is named by its key and value, and all of them at once.

`test_keys.py` has mistakes of one key; here are mistakes between keys, and in files.
"""

from __future__ import annotations

import itertools
import math
import pickle
import re

import numpy as np
import pytest

from pvdf_fem import build_response, gradients, modes, respond
from pvdf_fem.batch.plan import plan_solves
from pvdf_fem.scene.scene import Scene, SceneError
from pvdf_fem.surrogate.response_key import make_mechanical_key
from tests.helpers.refusals import keys, refused, refused_text
from tests.helpers.strategies import electrode

RING = '[electrodes]\nlayout = "ring"\n'
POLYGON = '[probe]\nshape = "polygon"\n'
ELLIPSE = '[probe]\nshape = "ellipse"\n'
CROSSED = "vertices_mm = [[0, 0], [1, 1], [1, 0], [0, 1]]"
BY_EDGES = '[numerics]\nobservable = "thesis-edge"'
CONTACT = '[load]\nkind = "contact"\n'
TAPE = "[[film.patches]]\nx_mm = 3\ny_mm = 0\nthickness_um = 50\nside_mm = 3\n"
COOLED = TAPE + "bonded = 'before stretching'\nthermal_expansion_per_K = 1e-5\n"

#: Texts, and the key and value that the one complaint about each begins with.
REFUSALS = [
    # numbers and lists
    ("[film]\npretension_N_m = [9, 8, 7]", "film.pretension_N_m = [9, 8, 7]"),
    ("[film]\npretension_N_m = [9, 8]\ntemperature_change_K = -1", "film.temperature_change_K"),
    ("[film]\npoisson_ratio = 0.5", "film.poisson_ratio = 0.5"),
    ("[film]\npoisson_ratio = -0.1", "film.poisson_ratio = -0.1"),
    ("[film]\nyoungs_modulus_GPa = [1, 10]", "film.poisson_ratio = 0.34"),
    ("[film]\nrim_displacement_um = [0, 1]", "film.rim_displacement_um = [0, 1]"),
    ("[model]\nforce_range_N = [2, 1]", "model.force_range_N = [2, 1]"),
    ('[film]\nlaw = "neo-hookean"\nyoungs_modulus_GPa = [1, 2]', 'film.law = "neo-hookean"'),
    ('[film]\nlaw = "neo-hookean"\nshear_modulus_GPa = 1', 'film.law = "neo-hookean"'),
    ("probe = []", "probe = []"),
    ("electrodes = [3]", "electrodes[0] = 3"),
    # shapes
    ('[[electrodes]]\nname = "A"\ny_mm = 0', "electrodes[0].x_mm: is required"),
    (electrode(shape="circle"), "electrodes[0].radius_mm: is required"),
    (POLYGON + "vertices_mm = [[0, 0], [1, 0]]", "probe.vertices_mm = [[0, 0], "),
    (POLYGON + CROSSED, "probe.vertices_mm = [[0, 0], "),
    (POLYGON + f"vertices_mm = [{1001 * '[0, 0],'}]", "probe.vertices_mm = [[0, 0], "),
    # names
    (electrode("a/b"), 'electrodes[0].name = "a/b"'),
    (electrode(41 * "a"), 'electrodes[0].name = "aaa'),
    (electrode() + electrode(x_mm=9), 'electrodes[1].name = "A"'),
    # overlaps
    (electrode() + electrode("B", x_mm=2.9), "electrodes[1].x_mm = 2.9"),
    ("[[probe]]\n[[probe]]\nx_mm = 1.0", "probe[1].x_mm = 1.0"),
    ("[electrodes]\nring_radius_mm = 2", "electrodes.ring_radius_mm = 2.0"),
    (RING + "ring_radius_mm = 2.5\ncount = 2\ncentre = true", "electrodes.ring_radius_mm = 2.5"),
    # over the rim
    (RING + "ring_radius_mm = 44", "electrodes.ring_radius_mm = 44.0"),
    (electrode(x_mm=-44), "electrodes[0].x_mm = -44.0"),
    ("[probe]\ny_mm = 42", "probe.y_mm = 42.0"),
    ('[probe]\nshape = "circle"\nradius_mm = 46', "probe.radius_mm = 46.0"),
    (ELLIPSE + "semi_axes_mm = [3, 46]", "probe.semi_axes_mm = [3.0, 46.0]"),
    ("[probe]\nshape = 'sphere'\nx_mm = 50\n" + CONTACT, "probe.x_mm = 50.0"),
    (TAPE.replace("x_mm = 3", "x_mm = 60"), "film.patches = [a table]"),
    # the thesis's means need upright rectangles
    (electrode(shape="circle", radius_mm=1) + BY_EDGES, 'electrodes[0].shape = "circle"'),
    (electrode(rotation_deg=45) + BY_EDGES, "electrodes[0].rotation_deg = 45.0"),
    # loads
    ('[probe]\nshape = "circle"\nradius_mm = 45\n[load]\nkind = "rigid"', 'load.kind = "rigid"'),
    ('[probe]\n[load]\nprofile = "hertz"', 'load.profile = "hertz"'),
    ('[[probe]]\nload = { profile = "hertz" }', 'probe[0].load.profile = "hertz"'),
    ('[load]\nkind = "follower"\ntangential_N = [1, 0]', "load.tangential_N = [1, 0]"),
    ('[load]\nkind = "rigid"\ntangential_N = [1, 0]', "load.tangential_N = [1, 0]"),
    (CONTACT + "tangential_N = [0.1, 0]", "load.tangential_N = [0.1, 0]"),
    (CONTACT + "depth_mm = 1\nforce_N = 1", "load.force_N = 1"),
    (CONTACT + "force_N = 0", "load.force_N = 0"),
    (CONTACT + "friction = 0.3", "load.friction = 0.3"),
    ("[[probe]]\nforce_N = 1.0\nload = { force_N = 2.0 }", "probe[0].load = a table"),
    ("[load]\nkind = 'rigid'\n[[probe]]\ntangential_N = [1, 0]", "probe[0].tangential_N = [1.0, "),
    ("[load]\ntangential_N = [1, 0]\n[[probe]]\nload = { kind = 'follower' }", "load.tangential_N"),
    # tips
    ('[probe]\nshape = "sphere"', 'probe.shape = "sphere"'),
    ('[probe]\nshape = "sphere"\nedge_radius_mm = 1\n' + CONTACT, "probe.edge_radius_mm = 1"),
    ("[probe]\n" + CONTACT, 'probe.shape = "triangle"'),
    ("[[probe]]\nload = { kind = 'contact' }", 'probe[0].shape = "triangle"'),
    ("[probe]\nedge_radius_mm = 5\n" + CONTACT, "probe.edge_radius_mm = 5.0"),
    (ELLIPSE + "semi_axes_mm = [3, 2]\nedge_radius_mm = 1\n" + CONTACT, "probe.edge_radius_mm"),
    ("[probe]\nedge_radius_mm = 0.2", "probe.edge_radius_mm = 0.2"),
    # amplifiers
    ("[readout]\nkind = { A = 3 }", "readout.kind.A = 3"),
    ("[readout]\ngain = { E = 1 }", "readout.gain.E = 1.0"),
    ("[readout]\nfeedback_resistance_MOhm = { A = nan }", "readout.feedback_resistance_MOhm.A"),
    ("[readout]\nfull_scale_V = 0.0", "readout.full_scale_V = 0.0"),
    ('[readout]\nchannels = { E = "ai0" }', 'readout.channels.E = "ai0"'),
    ('[readout.channels]\nA = "ai0"\nB = "ai0"', "readout.channels = a table: has 'ai0'"),
    ('[readout]\nchannels = { A = " " }', "readout.channels = a table: has no name"),
    ("[readout]\nrange_V = 0", "readout.range_V = 0"),
    ("[readout]\nrange_V = -5", "readout.range_V = -5"),
    ("[readout]\nrange_V = [5, 5]", "readout.range_V = [5, 5]"),
    ("[readout]\nrange_V = { B = [2, 1] }", "readout.range_V.B = [2, 1]"),
    ("[readout]\nrange_V = { B = 0.0 }", "readout.range_V.B = 0.0"),
    ("[readout]\nrange_V = { E = 5.0 }", "readout.range_V.E = 5.0"),
    ("[readout]\nrange_V = [0.5, 4.5]", "readout.range_V = [0.5, 4.5]"),
    ("[readout]\nrange_V = 5\noffset_V = { C = -5.1 }", "readout.range_V = 5"),
    ("[readout]\nrange_V = { C = [0, 5] }\noffset_V = 5.1", "readout.range_V.C = [0.0, 5.0]"),
    ("[readout]\nmains_Hz = 44.9", "readout.mains_Hz = 44.9"),
    ("[readout]\nmains_Hz = 65.1", "readout.mains_Hz = 65.1"),
    ("[readout]\nmains_Hz = 'off'", 'readout.mains_Hz = "off"'),
    ("[readout]\nsettling_s = 0", "readout.settling_s = 0"),
    # deviations
    *(
        (f"[uncertain]\nfilm.d31_pC_N = {value}", "uncertain = a table")
        for value in ('"x"', '"-5 %"', 0, -1.0, 1e13, "true")
    ),
    # films
    ("[film]\ncoupling = true\nd31_pC_N = 900", "film.coupling = true"),
    (COOLED + "[film]\npretension_N_m = 9", "film.patches = [a table]"),
    (
        f"{TAPE}bonded = 'before stretching'\n[film]\npretension_N_m = 9\nlaw = 'neo-hookean'",
        "film.pretension_N_m = 9.0",
    ),
]


#: Keys and words that are none, with one that is offered.
OFFERED = [
    ("[films]", "films = a table", "film"),
    ("[film]\nthicknes_um = 30", "film.thicknes_um = 30", "thickness_um"),
    ("[film]\nd31 = 7", "film.d31 = 7", "d31_pC_N"),
    ("[probe]\nradius_mm = 1", "probe.radius_mm = 1", "circle"),
    ('[electrodes]\nname = "A"', 'electrodes.name = "A"', "[[electrodes]]"),
    ("[electrodes]\nnam = 1", "electrodes.nam = 1", "side_mm"),
    ("[film.patches]\nx_mm = 1", "film.patches = a table", "[[film.patches]]"),
    ("[[load]]\nforce_N = 1", "load = [a table]", "[load]"),
    (electrode(shape="triangel"), 'electrodes[0].shape = "triangel"', "triangle"),
    ("[load]\nkind = 3", "load.kind = 3", "follower"),
    ("[film]\nradius_mm = 0.045", "electrodes.ring_radius_mm = 10.0", "45 mm"),
]


@pytest.mark.parametrize(
    ("text", "key_and_value", "offered"), [*((*row, "") for row in REFUSALS), *OFFERED]
)
def test_an_error_names_key_and_value(text, key_and_value, offered):
    with pytest.raises(SceneError) as caught:
        Scene.parse(text)
    (message,) = caught.value.problems
    assert message.startswith(key_and_value)
    assert offered in message.partition(": ")[2]


LAYER = {"x_mm": 0.0, "y_mm": 0.0, "side_mm": 3.0, "thickness_um": 9.0}
STRETCHED = {**LAYER, "bonded": "before stretching"}
#: Effects by name.
EFFECTS = {
    "wrinkles": {"film.compression": "tension-field"},
    "bends": {"film.bending": True},
    "may bend": {"film.bending": "auto"},
    "coupled": {"film.coupling": True, "readout.kind": "voltage"},
    "d33": {"film.d33_pC_N": -15.0},
    "tension": {"film.pretension_N_m": 9.0},
    "edges": {"numerics.observable": "thesis-edge"},
    "tape": {"film.patches": [LAYER]},
    "stretched tape": {"film.patches": [STRETCHED]},
    "rim": {"film.rim_displacement_um": [1.0]},
    "warming": {"film.warming_K": 1.0},
    "rubber": {"film.law": "neo-hookean"},
    "pressure": {"film.pressure_Pa": 5.0},
    "weight": {"film.gravity_m_s2": 5.0},
    "warm": {"probe.temperature_K": 10.0},
    "tip": {"probe.shape": "sphere", "load.kind": "contact"},
    "backing": {"film.backing_N_m3": 1e5},
    "backed part": {"film.patches": [{"x_mm": 0.0, "y_mm": 0.0, "backing_N_m3": 1e5}]},
}
LIFTED = {"film.backing_N_m3": 1e5, "film.backing_one_sided": True}
#: Films that only touch a one-sided backing.
UNPRESSED = {"lifted": LIFTED, "unloaded backing": {**LIFTED, "load.force_N": 0.0}}
TAPES, PLATES = ["tape", "stretched tape"], ["bends", "may bend"]
#: Keys that are refused where one of some effects meets one of others.
UNLIKE = [
    ("film.compression", ["wrinkles"], [*PLATES, *TAPES, "coupled", "rim", "rubber", "warm"]),
    ("film.bending", PLATES, [*TAPES, "rubber"]),
    ("film.bending", ["bends"], ["tip"]),
    ("film.coupling", ["coupled"], ["stretched tape", "rim", "warming", "rubber", "warm"]),
    ("film.d33_pC_N", ["d33"], TAPES),
    ("numerics.observable", ["edges"], ["coupled", "rim", "warm"]),
    ("load.kind", ["pressure", "weight", "warm"], ["tip"]),
    ("probe.temperature_K", ["warm"], ["backing", "backed part"]),
]
REFUSED = {frozenset([a, b]): key for key, ones, others in UNLIKE for a in ones for b in others}


@pytest.mark.parametrize(("one", "other"), [*itertools.combinations(EFFECTS, 2)])
def test_two_effects_are_combined_or_refused_by_key(one, other):
    changes = {"probe.shape": "circle", **EFFECTS[one], **EFFECTS[other]}
    if key := REFUSED.get(frozenset([one, other])):
        assert keys(refused(Scene().with_, changes)) == [key]
    else:
        Scene().with_(changes)


@pytest.mark.parametrize(
    ("refuses", "effect", "key"),
    [
        (build_response, "tape", "film: patches"),
        (build_response, "warm", "probe.temperature_K"),
        (lambda scene: plan_solves([scene]), "warm", "probe.temperature_K"),
        (build_response, "backed part", "film: patches"),
        (modes, "lifted", "film.backing_one_sided = true"),
        (lambda scene: respond(scene, 20.0), "unloaded backing", "film.backing_one_sided = true"),
        (build_response, "pressure", "film.pressure_Pa"),
        (build_response, "weight", "film.gravity_m_s2"),
        (make_mechanical_key, "coupled", "film.coupling"),
        (lambda scene: respond(scene, 20.0), "coupled", "film.coupling"),
        (lambda scene: respond(scene, 20.0), "d33", "film.d33_pC_N"),
        (lambda scene: plan_solves([scene]), "d33", "film.d33_pC_N"),
        *((serves, "d33", "film.d33_pC_N") for serves in (make_mechanical_key, gradients)),
    ],
)
def test_functions_refuse_films_that_they_do_not_support(refuses, effect, key):
    with pytest.raises(ValueError, match=re.escape(key)):
        refuses(Scene.example("triangle").with_((EFFECTS | UNPRESSED)[effect]))


def test_all_errors_of_a_file_are_reported_at_once():
    text = "bogus = 1\n[film]\nthicknes_um = 30\npoisson_ratio = 0.7\n[load]\nkind = 'ded'\n"
    text += electrode(y_mm=44) + electrode("B", x_mm="1") + electrode(x_mm=1, y_mm=44)
    text += "[[probe]]\nx_mm = 60\n[[probe]]\nx = 1\n"
    single = ["film.thicknes_um", "film.poisson_ratio", "electrodes[1].x_mm", "probe[1].x"]
    # and what is wrong between the parts that are valid by themselves
    between = ["electrodes[0].y_mm", "electrodes[2].y_mm", "electrodes[2].name"]
    between += ["electrodes[2].x_mm", "probe[0].x_mm"]
    assert keys(refused_text(text)) == [*single, "load.kind", "bogus", *between]


def test_an_invalid_radius_hides_rim_errors_but_not_overlaps():
    text = "[film]\nradius_mm = -1\n[probe]\nx_mm = 43\n[electrodes]\nring_radius_mm = 1"
    assert keys(refused_text(text)) == ["film.radius_mm", "electrodes.ring_radius_mm"]


@pytest.mark.parametrize(
    "text",
    [
        '[probe]\nshape = "rectangle"\nwidth_mm = 54\nheight_mm = 72',  # corners on the rim
        ELLIPSE + "semi_axes_mm = [45, 20]\nrotation_deg = 30",
        electrode() + electrode("B", x_mm=0.3 + 2.7, y_mm=3),
        "[probe]\nshape = 'sphere'\nx_mm = 44\n" + CONTACT,  # its lowest point is on the film
    ],
)
def test_touching_is_allowed(text):
    Scene.parse(text)


@pytest.mark.parametrize(
    ("raw", "where"),
    [
        (b"[film]\nradius_mm == 45", "line 2"),
        (b"[film]\n# \xb5m", "line 2"),
        ("[film]".encode("utf-16"), "UTF-16"),
        (b"[film]\rradius_mm = 45", "CR"),
        (b"#" * 1_000_001, "1000000"),
        (None, ""),
    ],
)
def test_unreadable_files_are_refused_with_path_and_line(tmp_path, raw, where):
    path = tmp_path / "scene.toml"
    if raw is not None:
        path.write_bytes(raw)
    with pytest.raises(SceneError, match=rf"scene\.toml.*{where}"):
        Scene.from_file(path)
    path.write_text("[load]\nforce_N = 2", encoding="utf-8-sig")  # its mark is no mistake
    assert Scene.from_file(str(path)).load.force == 2.0


LONG = [[math.cos(t), math.sin(t)] for t in np.linspace(0, 6.28, 700).round(3)]
CATASTROPHES = {
    "deep lists": "x = " + "[" * 300_000,
    "deep lists, closed": "[load]\nforce_N = " + "[" * 300 + "]" * 300,
    "deep keys": ".".join("a" * 300_000) + " = 1",
    "deep quoted keys": " . ".join(['"a"'] * 100_000) + " = 1",
    "deep inline keys": "x = {" + ".".join("a" * 300_000) + " = 1}",
    "decimal digits": "[load]\nforce_N = " + "1" * 900_000,
    "hexadecimal digits": "[load]\nkind = 0x" + "f" * 900_000,
    "long key": "[load]\n" + "k" * 900_000 + " = 1",
    "long text": '[load]\nkind = "' + "k" * 900_000 + '"',
    "many keys": "\n".join(f"k{i} = 1" for i in range(80_000)),
    "many electrodes": electrode() * 2_000,
    "many long outlines": "".join(
        electrode(f"E{i}", shape="polygon", vertices_mm=LONG) for i in range(30)
    ),
}


@pytest.mark.parametrize("text", CATASTROPHES.values(), ids=CATASTROPHES.keys())
def test_catastrophic_files_are_refused_briefly(text):
    with pytest.raises(SceneError) as caught:
        Scene.parse(text)
    assert len(caught.value.problems) in (*range(20), 101)  # the last says that there are more
    assert max(map(len, caught.value.problems)) < 400


def test_a_scene_error_is_printed_and_pickled():
    with pytest.raises(SceneError) as caught:
        Scene.parse("[film]\nradius_mm = -1", "somewhere.toml")
    copy = pickle.loads(pickle.dumps(caught.value))
    assert (copy.problems, str(copy)) == (caught.value.problems, str(caught.value))
    assert "somewhere.toml" in str(copy)
    with pytest.raises(SceneError) as caught:
        Scene().with_(electrodes=[{"name": "\ud800", "x_mm": 0, "y_mm": 0}])
    assert b"ud800" in str(caught.value).encode()
