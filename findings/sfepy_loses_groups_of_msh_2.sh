#!/bin/sh
# sfepy: the physical groups of an MSH file of version 2.2 are lost, those of 4.1 get other numbers.
#
# Versions: sfepy 2026.3, meshio 5.3.5.
# Input:    two electrodes, physical groups 10 ("right") and 20 ("left"), in MSH 2.2 and in MSH 4.1.
# Expected: cell groups 10 and 20 in both, so that a region "cells of group 10" is the right one;
#           meshio, by which sfepy reads the files, has these numbers for both of them.
# Seen:     from MSH 2.2 all cells are in group 1. From MSH 4.1 the groups are numbered by the
#           alphabet, after a set of meshio's own: left is 2, right is 3. There is no warning.
# The script fails if that changes.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --disable-pip-version-check install --quiet sfepy==2026.3 meshio==5.3.5
cd "$folder"
cat >two.msh <<'MSH'
$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
2
2 10 "right"
2 20 "left"
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
4
1 2 2 20 1 1 2 5
2 2 2 20 1 1 5 4
3 2 2 10 2 2 3 6
4 2 2 10 2 2 6 5
$EndElements
MSH
cat >four.msh <<'MSH'
$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
2
2 10 "right"
2 20 "left"
$EndPhysicalNames
$Entities
0 0 2 0
1 0 0 0 1 1 0 1 20 0
2 1 0 0 3 1 0 1 10 0
$EndEntities
$Nodes
2 6 1 6
2 1 0 4
1
2
4
5
0 0 0
1 0 0
0 1 0
1 1 0
2 2 0 2
3
6
3 0 0
3 1 0
$EndNodes
$Elements
2 4 1 4
2 1 2 2
1 1 2 5
2 1 5 4
2 2 2 2
3 2 3 6
4 2 6 5
$EndElements
MSH
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import meshio
import numpy as np
from sfepy.base.base import output
from sfepy.discrete.fem import Mesh

output.set_output(quiet=True)
print("sfepy", version("sfepy"), "meshio", version("meshio"))
found = {}
for name in ("two.msh", "four.msh"):
    numbers = np.concatenate(meshio.read(name).cell_data["gmsh:physical"])
    found[name] = Mesh.from_file(name).cmesh.cell_groups.tolist()
    print(name, "meshio:", numbers.tolist(), "sfepy:", found[name])
    assert numbers.tolist() == [20, 20, 10, 10]
assert found["two.msh"] == [1, 1, 1, 1], "MSH 2.2 has groups: the behaviour has changed"
assert found["four.msh"] == [2, 2, 3, 3], "MSH 4.1 has other numbers: the behaviour has changed"
PYTHON
