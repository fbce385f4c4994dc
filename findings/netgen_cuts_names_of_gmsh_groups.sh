#!/bin/sh
# netgen: ReadGmsh cuts the names of physical groups at a blank, so that groups become one.
#
# Versions: netgen-mesher 6.2.2608 (of ngsolve 6.2.2608), meshio 5.3.5.
# Input:    an MSH file of version 2.2 with two square electrodes of 1 m and 2 m². The format puts
#           names in quotes, so they may have blanks: "electrode A", "electrode B".
# Expected: materials "electrode A" and "electrode B", as meshio reads them, or an error.
# Seen:     both are called "electrod": the name is cut at the blank, and its last letter is taken
#           for the closing quote. There is no warning. A coefficient or an integral over one
#           electrode by its name covers both.
# The script fails if that changes.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --disable-pip-version-check install --quiet ngsolve==6.2.2608 meshio==5.3.5
cd "$folder"
cat >film.msh <<'MSH'
$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
3
1 3 "rim"
2 1 "electrode A"
2 2 "electrode B"
$EndPhysicalNames
$Nodes
6
1 0 0 0
2 1 0 0
3 3 0 0
4 0 1 0
5 1 1 0
6 3 1 0
$EndNodes
$Elements
10
1 1 2 3 1 1 2
2 1 2 3 1 2 3
3 1 2 3 1 3 6
4 1 2 3 1 6 5
5 1 2 3 1 5 4
6 1 2 3 1 4 1
7 2 2 1 1 1 2 5
8 2 2 1 1 1 5 4
9 2 2 2 2 2 3 6
10 2 2 2 2 2 6 5
$EndElements
MSH
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import meshio
from netgen.read_gmsh import ReadGmsh
from ngsolve import CoefficientFunction, Integrate, Mesh

print("ngsolve", version("ngsolve"), "meshio", version("meshio"))
groups = meshio.read("film.msh").field_data
print("meshio:", *groups, sep=" | ")
mesh = Mesh(ReadGmsh("film.msh"))
materials = mesh.GetMaterials()
print("netgen:", *materials, sep=" | ")
one = CoefficientFunction(1.0)
area = Integrate(one, mesh, definedon=mesh.Materials(materials[0]))
print(f"area of the first electrode by its name: {area:g} m²; it has 1 m²")
assert {"electrode A", "electrode B"} < groups.keys()
assert materials == ("electrod", "electrod"), "the names differ: the behaviour has changed"
assert abs(area - 3.0) < 1e-12
PYTHON
