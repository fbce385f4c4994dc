#!/bin/sh
# netgen: ReadGmsh keeps triangles of second order curved but makes their boundary straight.
#
# Versions: netgen-mesher 6.2.2608 (of ngsolve 6.2.2608).
# Input:    an MSH file of version 2.2 of a disc of radius 1: six triangles of six nodes, and six
#           boundary lines of three nodes, which share the nodes of the triangles' outer edges.
# Expected: area and boundary length of the same curved disc: 3.134 and 6.276 (a true disc has
#           3.142 and 6.283), or straight edges in both: 2.598 and 6.
# Seen:     the area is that of the curved disc, the length is 6, that of the hexagon through the
#           corners. An integral over the boundary is 4.5 % too small, and the theorem of Gauss does
#           not hold for it. There is no warning.
# The script fails if that changes.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --disable-pip-version-check install --quiet ngsolve==6.2.2608
cd "$folder"
venv/bin/python - <<'PYTHON'
import math
from importlib.metadata import version

from netgen.read_gmsh import ReadGmsh
from ngsolve import BND, CoefficientFunction, Integrate, Mesh, specialcf, x, y

COUNT = 6
# Node 1 is the centre; then come corners, middles of the rim, and middles of the spokes.
nodes = [(0.0, 0.0)]
for radius, offset in ((1.0, 0.0), (1.0, 0.5), (0.5, 0.0)):
    for i in range(COUNT):
        angle = 2.0 * math.pi * (i + offset) / COUNT
        nodes.append((radius * math.cos(angle), radius * math.sin(angle)))
elements = []
for i in range(COUNT):
    j = (i + 1) % COUNT
    corner, following, middle = 2 + i, 2 + j, 2 + COUNT + i
    spoke, next_spoke = 2 + 2 * COUNT + i, 2 + 2 * COUNT + j
    elements.append(f"8 2 2 1 {corner} {following} {middle}")
    elements.append(f"9 2 1 1 1 {corner} {following} {spoke} {middle} {next_spoke}")
lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat"]
lines += ["$PhysicalNames", "2", '1 2 "rim"', '2 1 "film"', "$EndPhysicalNames"]
lines += ["$Nodes", str(len(nodes))]
lines += [f"{number} {place[0]!r} {place[1]!r} 0" for number, place in enumerate(nodes, 1)]
lines += ["$EndNodes", "$Elements", str(len(elements))]
lines += [f"{number} {element}" for number, element in enumerate(elements, 1)]
lines += ["$EndElements", ""]
with open("disc.msh", "w") as file:
    file.write("\n".join(lines))

print("ngsolve", version("ngsolve"))
read = ReadGmsh("disc.msh")
read.dim = 2
mesh = Mesh(read)
one = CoefficientFunction(1.0)
area = Integrate(one, mesh, order=8)
length = Integrate(one, mesh, BND, order=8)
normal = specialcf.normal(2)
flux = Integrate(x * normal[0] + y * normal[1], mesh, BND, order=8)
print(f"area {area:.4f}, length {length:.4f}; flux of (x, y) {flux:.4f}, twice the area is right")
assert abs(area - 3.134) < 1e-4, "the triangles are straight, too: the behaviour has changed"
assert abs(length - 6.0) < 1e-9, "the lines are curved: the behaviour has changed"
PYTHON
