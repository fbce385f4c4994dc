#!/bin/sh
# compliance-checker: coordinates with axis = "X" and "Y" count as longitude and latitude.
#
# Versions: compliance-checker 6.1.0.
# Input:    a NetCDF file with a deflection on a grid of x and y in mm. Its coordinates have the
#           attributes axis = "X" and axis = "Y", as section 4 of CF 1.11 recommends for generic
#           spatial coordinates, which are neither longitude nor latitude.
# Expected: no issue, as in the same file without the two attributes.
# Seen:     warnings that x and y "should define valid units" for longitude and latitude, and an
#           error that the dimensions of the coordinate variable x "are not a subset" of those of
#           the deflection, although (x) is a subset of (y, x).
# The script fails if that changes.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --disable-pip-version-check install --quiet compliance-checker==6.1.0
cd "$folder"
venv/bin/python - <<'PYTHON'
import json
import subprocess
from importlib.metadata import version

from netCDF4 import Dataset


def check(name, axes):
    """Write the grid to a file, and return the messages of the checker about it."""
    with Dataset(name, "w", format="NETCDF3_CLASSIC") as file:
        file.setncatts({"Conventions": "CF-1.11", "title": "a film", "history": "made up"})
        for dimension in ("y", "x"):
            file.createDimension(dimension, 3)
            coordinate = file.createVariable(dimension, "f8", (dimension,))
            coordinate.setncatts({"long_name": f"{dimension} on the film", "units": "mm"})
            coordinate.setncatts(axes.get(dimension, {}))
            coordinate[:] = [-1.0, 0.0, 1.0]
        deflection = file.createVariable("deflection", "f8", ("y", "x"))
        deflection.setncatts({"long_name": "deflection", "units": "mm"})
        deflection[:] = 0.0
    command = ["venv/bin/compliance-checker", "--test=cf:1.11", "--criteria=strict"]
    command += ["--format=json", "--output=report.json", name]
    subprocess.run(command, check=False, capture_output=True)
    with open("report.json") as file:
        report = json.load(file)["cf:1.11"]
    return [message for result in report["all_priorities"] for message in result["msgs"]]


print("compliance-checker", version("compliance-checker"))
plain = check("plain.nc", {})
print("without axis:", plain or "no issue")
marked = check("marked.nc", {"x": {"axis": "X"}, "y": {"axis": "Y"}})
print("with axis:", *marked, sep="\n  ")
assert plain == []
text = "\n".join(marked)
assert "longitude variable 'x' should define valid units" in text, "the behaviour has changed"
assert "not a subset of deflection's dimensions" in text, "the behaviour has changed"
PYTHON
