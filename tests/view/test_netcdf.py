"""NetCDF files that follow the CF conventions 1.11.

The rules are those that compliance-checker 6.1 names for such files; it finds no issue in them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from unittest import mock

import numpy as np
import pytest
import xarray
from scipy.io import netcdf_file

from pvdf_fem import Scene, dataset, design, solve
from pvdf_fem.batch import batch
from pvdf_fem.scene.keys import UNITS
from pvdf_fem.studies.sweep import sweep
from pvdf_fem.view.files.netcdf import make_attributes, write_netcdf
from tests.helpers.bump_response import make_bump_response
from tests.helpers.sweep_cases import AXES, BASE, made_up

#: Units that udunits 2.2 parses.
KNOWN_UNITS = {"1", "mm", "um", "GPa", "MPa", "Pa", "pF", "pC", "K", "N", "V", "s", "Hz"}
KNOWN_UNITS |= {"degree", "Mohm", "1/K", "pC/N", "N/m", "kg/m3", "N/m3"}
KNOWN_UNITS |= {"m2/s", "m/s2", "uC/(m2 K)", "pC/mm2"}
ENGINES = {"scipy": "scipy", "netcdf4": "netCDF4"}


def make_sweep() -> xarray.Dataset:
    """Return a sweep with texts, unordered and repeated numbers, and two keys of one axis."""
    axes = [
        {"film.thickness_um": [25, 9, 52, 9]},
        {"film.compression": ["refuse", "tension-field"]},
        {"probe.rotation_deg": [0, 10]},
        {"probe.x_mm": [1.0, 2.0], "probe.y_mm": [0.0, 3.0], "name": "y_mm"},
    ]
    with mock.patch.object(batch, "make_records", made_up):
        return sweep(BASE.with_(readout={}), axes, processes=1)


def make_touches() -> xarray.Dataset:
    response = make_bump_response("rectangle")
    return dataset(response.scene, 50, 2**31 - 1, 0.01, response=response)


def make_designs() -> xarray.Dataset:
    scene = Scene().with_(**{"probe.shape": "circle"})

    def respond(scene):
        return make_bump_response("circle").for_scene(scene)

    return design(scene, {"electrodes.ring_radius_mm": [8, 10]}, step_mm=6.0, response=respond)


def make_fields() -> xarray.Dataset:
    scene = Scene().with_(**{"film.radius_mm": 12.0, "electrodes.ring_radius_mm": 6.0})
    probe = {"probe.shape": "circle", "probe.x_mm": 2.0, "numerics.tolerance": 0.02}
    return solve(scene.with_(**probe)).to_xarray(step_mm=2.0)


MAKERS = {
    "sweep": make_sweep,
    "touches": make_touches,
    "designs": make_designs,
    "fields": make_fields,
}


@pytest.fixture(scope="module", params=MAKERS)
def data(request):
    return MAKERS[request.param]()


def decode(attribute: object) -> object:
    return attribute.decode() if isinstance(attribute, bytes) else attribute


def find_violations(path) -> Iterator[str]:
    """Yield what in a NetCDF3 file breaks a rule of CF, as scipy reads the file."""
    with netcdf_file(path, mmap=False) as file:
        attributes = file._attributes
        for name in ("Conventions", "title", "source", "history"):
            if not attributes.get(name):
                yield f"global attribute {name} is missing (2.6)"
        for name, variable in file.variables.items():
            about = {key: decode(value) for key, value in variable._attributes.items()}
            for problem in find_variable_violations(name, variable, about, file):
                yield f"{name}: {problem}"


def find_variable_violations(name, variable, about, file) -> Iterator[str]:
    """Yield what in a variable breaks a rule of CF, with the section of the rule."""
    if not re.fullmatch(r"[A-Za-z]\w*", name, re.ASCII):
        yield "has a name with other signs than letters, digits and underscores (2.3)"
    if not about.get("long_name"):
        yield "has no long_name (3.2)"
    is_text = variable.typecode() == "c"
    is_flag = "flag_values" in about
    if about.get("units", "1" if is_text or is_flag else "") not in KNOWN_UNITS:
        yield f"has the units {about.get('units')} (3.1)"
    named = about.get("coordinates", "").split()
    for other in [*named, *about.get("ancillary_variables", "").split()]:
        if other not in file.variables:
            yield f"names {other}, which is missing (3.4, 5)"
        elif not set(file.variables[other].dimensions) <= {*variable.dimensions}:
            yield f"names {other}, which has another dimension (3.4, 5)"
    if is_flag:
        values = about["flag_values"]
        if values.dtype != variable.data.dtype or len(values) != len(set(values.tolist())):
            yield "has flag values of another type or repeated ones (3.5)"
        if len(about["flag_meanings"].split()) != len(values):
            yield "has more or fewer meanings than flag values (3.5)"
        if not np.isin(variable.data, values).all():
            yield "has values without a meaning (3.5)"
    if name in file.dimensions:
        if {"_FillValue", "missing_value"} & about.keys():
            yield "is a coordinate with a value for missing ones (2.5.1)"
        steps = np.diff(variable.data) if not is_text else np.ones(1)
        if not ((steps > 0).all() or (steps < 0).all()):
            yield "is a coordinate that neither increases nor decreases (1.3)"


def test_files_follow_the_conventions(data, tmp_path):
    write_netcdf(data, tmp_path / "a.nc")
    assert [*find_violations(tmp_path / "a.nc")] == []
    if "thickness_um" not in data:  # Only the writer of this package sorts.
        data.to_netcdf(tmp_path / "b.nc", engine="scipy")
        assert [*find_violations(tmp_path / "b.nc")] == []


def test_files_that_xarray_writes_by_itself_break_the_rules(data, tmp_path):
    """The check finds what compliance-checker finds in them."""
    plain = data.drop_encoding().drop_attrs()
    plain.to_netcdf(tmp_path / "a.nc", engine="scipy")
    violations = "\n".join(find_violations(tmp_path / "a.nc"))
    for words in ("Conventions is missing", "no long_name", "units None"):
        assert words in violations
    has_numbers = any(data[name].dtype.kind == "f" for name in data.indexes)
    assert ("(2.5.1)" in violations) == has_numbers
    assert ("(1.3)" in violations) == ("thickness_um" in data)


@pytest.mark.parametrize("engine", ENGINES)
def test_every_engine_reads_an_equal_dataset(data, tmp_path, engine):
    pytest.importorskip(ENGINES[engine])
    write_netcdf(data, tmp_path / "a.nc")
    expected = data
    if "thickness_um" in data:
        expected = data.isel(thickness_um=[1, 0, 2])
    with xarray.open_dataset(tmp_path / "a.nc", engine=engine) as read:
        xarray.testing.assert_identical(read, expected)


def test_netcdf4_files_of_a_dataset_are_read_by_each_of_its_engines(data, tmp_path):
    for module in ("h5netcdf", "netCDF4"):
        pytest.importorskip(module)
    data.to_netcdf(tmp_path / "a.nc", engine="h5netcdf")
    for engine in ("h5netcdf", "netcdf4"):
        with xarray.open_dataset(tmp_path / "a.nc", engine=engine) as read:
            xarray.testing.assert_equal(read, data)


def test_netcdf4_python_sees_missing_numbers_as_masked(tmp_path):
    netcdf4 = pytest.importorskip("netCDF4")
    fields = make_fields()
    write_netcdf(fields, tmp_path / "a.nc")
    with netcdf4.Dataset(tmp_path / "a.nc") as file:
        mask = np.ma.getmaskarray(np.ma.masked_invalid(file["deflection_mm"][:]))
        labels = file["stress_component"][:].tolist()
    assert (mask == np.isnan(fields.deflection_mm.values)).all()
    assert labels == ["S11", "S22", "S12"]


def test_units_of_all_keys_are_known_to_udunits():
    units = {make_attributes("", unit)["units"] for unit in UNITS.values()}
    assert units <= KNOWN_UNITS


def test_the_flag_of_a_status_has_its_meaning():
    with mock.patch.object(batch, "make_records", made_up):
        data = sweep(BASE, AXES, processes=1)
    about = data.status_flag.attrs
    flags = dict(zip(about["flag_meanings"].split(), about["flag_values"], strict=True))
    assert set(data.status_flag.values.ravel()) == {flags["converged"]}
    assert set(data.status.values.ravel()) == {"converged"}


@pytest.mark.parametrize("seed", [2**31 - 1, 2**31, 2**63 - 1])
def test_large_seeds_are_written_in_full(tmp_path, seed):
    response = make_bump_response("rectangle")
    write_netcdf(dataset(response.scene, 5, seed, 0.01, response=response), tmp_path / "a.nc")
    with xarray.open_dataset(tmp_path / "a.nc") as read:
        assert int(read.attrs["seed"]) == seed
