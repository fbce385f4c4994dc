"""Mesh files read by the programs for which they are written, if these are installed.

Each reader returns the areas of the film and of its electrodes in mm², as the program computes
them. `reports/guide/elsewhere.md` says what is checked here.
"""

from __future__ import annotations

import math
import re
import shutil
import subprocess

import meshio
import numpy as np
import pytest

from pvdf_fem.cli.main import main

SCENE = """
[film]
radius_mm = 45.0
[probe]
shape = "circle"
radius_mm = 2.0
x_mm = 5.0
y_mm = 1.0
"""
FILM_MM2 = math.pi * 45.0**2
PATCHES = {"electrode A": 9.0, "electrode B": 9.0, "electrode C": 9.0, "electrode D": 9.0}
OPTIONS = {
    "two.msh": [],
    "two22.msh": ["--format", "msh22"],
    "one.msh": ["--order", "1"],
    "one22.msh": ["--format", "msh22", "--order", "1"],
    "two.inp": [],
    "two.vtu": [],
    "one.vtu": ["--order", "1"],
}

pytestmark = pytest.mark.filterwarnings("ignore")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the mesh in each format, of order 1 or 2."""
    path = tmp_path_factory.mktemp("meshes")
    (path / "scene.toml").write_text(SCENE)
    for name, options in OPTIONS.items():
        assert main(["mesh", str(path / "scene.toml"), str(path / name), *options]) == 0
    return path


def assert_areas(areas, order):
    """Areas of the whole film and of the patches, by name.

    Triangles of order 1 are those of a polygon with 12 sides, which has 95.5 % of the circle.
    """
    polygon_mm2 = 6.0 * 45.0**2 * math.sin(math.pi / 6.0)
    expected = FILM_MM2 if order == 2 else polygon_mm2
    assert areas.pop("all") == pytest.approx(expected, rel=1e-6)
    for name, area in PATCHES.items():
        assert areas[name] == pytest.approx(area, rel=1e-9)


def sum_by_number(names, numbers, areas_m2):
    """Return the sums of areas by the name of their number, and of all, in mm²."""
    sums = {name: 1e6 * float(areas_m2[numbers == number].sum()) for name, number in names.items()}
    return {"all": 1e6 * float(areas_m2.sum()), **sums}


def number_surfaces(path):
    """Return the numbers of the surfaces of an MSH file by the names of their patches."""
    groups = meshio.read(path).field_data
    return {restore_name(name): number for name, (number, dim) in groups.items() if dim == 2}


def restore_name(group):
    """Return the name of a patch from that of its group, which has no blanks in MSH 2.2."""
    return group.replace("_", " ")


def parse_areas(output, path):
    """Return areas in mm² by name from lines such as `AREA 2 9e-06`; -1 stands for the film."""
    lines = re.findall(r"AREA (\S+) (\S+)", output)
    areas_mm2 = {int(number): 1e6 * float(area_m2) for number, area_m2 in lines}
    named = {name: areas_mm2[number] for name, number in number_surfaces(path).items()}
    return {"all": areas_mm2[-1], **named}


@pytest.mark.parametrize("name", ["two22.msh", "one22.msh"])
def test_ngsolve(folder, name, capsys):
    """It reads MSH 2.2, whose names have no blank. Six nodes need the line `dim = 2`."""
    ngsolve = pytest.importorskip("ngsolve")
    read_gmsh = pytest.importorskip("netgen.read_gmsh")
    geometry = read_gmsh.ReadGmsh(str(folder / name))
    geometry.dim = 2
    mesh = ngsolve.Mesh(geometry)
    one = ngsolve.CoefficientFunction(1.0)
    areas = {"all": 1e6 * ngsolve.Integrate(one, mesh)}
    for material in set(mesh.GetMaterials()):
        region = mesh.Materials(material)
        areas[restore_name(material)] = 1e6 * ngsolve.Integrate(one, mesh, definedon=region)
    assert_areas(areas, 2 if name == "two22.msh" else 1)
    assert set(mesh.GetBoundaries()) == {"rim"}


@pytest.mark.parametrize("name", ["one.msh", "one22.msh"])
def test_sfepy(folder, name, capsys):
    """Its mesh is made of what meshio reads, with two coordinates and the numbers of the file."""
    sfepy = pytest.importorskip("sfepy.discrete.fem")
    read = meshio.read(folder / name)
    triangles = read.get_cells_type("triangle")
    groups = read.get_cell_data("gmsh:physical", "triangle")
    mesh = sfepy.Mesh.from_data("film", read.points[:, :2], None, [triangles], [groups], ["2_3"])
    numbers = mesh.cmesh.cell_groups
    surfaces = number_surfaces(folder / name)
    assert_areas(sum_by_number(surfaces, numbers, mesh.cmesh.get_volumes(2)), 1)


@pytest.mark.parametrize("name", ["two.msh", "two22.msh", "one.msh", "one22.msh"])
def test_mfem(folder, name):
    serial = pytest.importorskip("mfem.ser")
    mesh = serial.Mesh(str(folder / name), 1, 1)
    assert (mesh.Dimension(), mesh.GetNBE()) == (2, 12)
    elements = range(mesh.GetNE())
    numbers = np.array([mesh.GetAttribute(i) for i in elements])
    areas_m2 = np.array([mesh.GetElementVolume(i) for i in elements])
    names = {}
    for patch in mesh.attribute_sets.GetAttributeSetNames():
        (names[restore_name(str(patch))],) = mesh.attribute_sets.GetAttributeSet(patch).ToList()
    assert_areas(sum_by_number(names, numbers, areas_m2), 2 if name.startswith("two") else 1)


GETFEM = """
import sys
import getfem
mesh = getfem.Mesh("import", "gmsh", sys.argv[1])
rule = getfem.MeshIm(mesh, getfem.Integ("IM_TRIANGLE(4)"))
for region in (-1, *mesh.regions()):
    print("AREA", region, getfem.asm_generic(rule, 0, "1", int(region)))
"""


@pytest.mark.parametrize("name", ["two.msh", "two22.msh", "one.msh", "one22.msh"])
def test_getfem(folder, name):
    """The regions have the numbers of the file."""
    python = "/usr/bin/python3"  # Debian's package python3-getfem is for this one.
    if subprocess.run([python, "-c", "import getfem"], capture_output=True).returncode:
        pytest.skip("getfem is not installed")
    command = [python, "-c", GETFEM, folder / name]
    output = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert_areas(parse_areas(output, folder / name), 2 if name.startswith("two") else 1)


FREEFEM = """
load "gmsh"
mesh film = gmshload("one22.msh");
cout.precision(15);
cout << "AREA -1 " << film.area << endl;
for (int i = 1; i < 8; ++i) cout << "AREA " << i << " " << int2d(film, i)(1.) << endl;
"""


def test_freefem(folder):
    """It reads MSH 2.2 of order 1. The regions have the numbers of the file."""
    program = shutil.which("FreeFem++-nw") or pytest.skip("FreeFEM is not installed")
    (folder / "film.edp").write_text(FREEFEM)
    command = [program, "-nw", "-v", "0", "film.edp"]
    output = subprocess.run(command, cwd=folder, capture_output=True, text=True).stdout
    if "Load error" in output:
        pytest.skip("FreeFEM is installed without its plug-in for gmsh")
    assert_areas(parse_areas(output, folder / "one22.msh"), 1)


CALCULIX = """*INCLUDE, INPUT=two.inp
*MATERIAL, NAME=PVDF
*ELASTIC
2e9, 0.34
*SHELL SECTION, ELSET=film, MATERIAL=PVDF
25e-6
*BOUNDARY
rim, 1, 3
*STEP
*STATIC
"""


def test_calculix(folder):
    """It reads elements S6 with their sets. Volumes divided by the thickness are areas."""
    program = shutil.which("ccx") or pytest.skip("CalculiX is not installed")
    sets = {"all": "film", **{name: name.replace(" ", "_") for name in PATCHES}}
    prints = [f"*EL PRINT, ELSET={name}, TOTALS=ONLY\nEVOL\n" for name in sets.values()]
    (folder / "volumes.inp").write_text(CALCULIX + "".join(prints) + "*END STEP\n")
    command = [program, "volumes"]
    subprocess.run(command, cwd=folder, capture_output=True, check=True, timeout=120)
    result = (folder / "volumes.dat").read_text()
    volumes = re.findall(r"total volume for set (\S+) .*\n\n\s*(\S+)", result)
    areas = {name.lower(): float(volume) / 25e-6 * 1e6 for name, volume in volumes}
    assert areas.pop("film") == pytest.approx(FILM_MM2, rel=1e-6)
    for name in PATCHES:
        assert areas[sets[name].lower()] == pytest.approx(PATCHES[name], rel=1e-6)


@pytest.mark.parametrize("name", ["two.vtu", "one.vtu"])
def test_pyvista_sees_the_polygon_through_the_nodes(folder, name):
    """Of six nodes, too, which lie a little outside the circle; the area is 98.87 %."""
    pyvista = pytest.importorskip("pyvista")
    mesh = pyvista.read(folder / name)
    areas_m2 = mesh.compute_cell_sizes(length=False, volume=False)["Area"]
    corners = 24 if name == "two.vtu" else 12
    polygon_mm2 = corners / 2.0 * 45.0**2 * math.sin(2.0 * math.pi / corners)
    assert 1e6 * areas_m2.sum() == pytest.approx(polygon_mm2, rel=2e-4)
    for patch, area in PATCHES.items():
        assert 1e6 * areas_m2[mesh[patch] == 1].sum() == pytest.approx(area, rel=1e-6)
