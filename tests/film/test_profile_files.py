"""Profiles in NetCDF files that the usual libraries write, in every format and layout."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest
import xarray
from scipy.io import netcdf_file

from pvdf_fem import Scene, solve
from pvdf_fem.film.loads.profile_files import read_profile
from pvdf_fem.scene.scene import SceneError

X_MM = np.array([-6.0, -1.0, 6.0])
Y_MM = np.array([-5.0, 0.0, 2.0, 5.0])
#: A pressure that bilinear interpolation reproduces, shape (y, x).
PRESSURE = (1.0 + 0.15 * X_MM) * (1.0 - 0.1 * Y_MM[:, None])
POINTS_MM = np.array([[0.0, 0.0], [-3.5, 4.0], [5.0, -4.5], [-5.9, 4.9]])
EXPECTED = (1.0 + 0.15 * POINTS_MM[:, 0]) * (1.0 - 0.1 * POINTS_MM[:, 1])
FORMATS = (
    "NETCDF3_CLASSIC",
    "NETCDF3_64BIT_OFFSET",
    "NETCDF3_64BIT_DATA",
    "NETCDF4",
    "NETCDF4_CLASSIC",
)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def netcdf4():
    return pytest.importorskip("netCDF4")


def make_data(**attributes):
    """Return the dataset of the pressure, with attributes of the pressure."""
    coordinates = {"x_mm": X_MM, "y_mm": Y_MM}
    return xarray.Dataset({"pressure": (("y_mm", "x_mm"), PRESSURE, attributes)}, coordinates)


def assert_read(path, rel=1e-12):
    """The file has the pressure at all points, and none outside its grid."""
    pressure = read_profile(path).pressure
    assert pressure(POINTS_MM) == pytest.approx(EXPECTED, rel=rel)
    assert pressure([[7.0, 0.0], [0.0, -6.0]]).tolist() == [0.0, 0.0]


def refuse(path):
    """Return the message that refuses a file, which names the key and the file once."""
    with pytest.raises(SceneError) as refused:
        read_profile(path)
    (message,) = refused.value.problems
    assert message.startswith(f'load.profile = "{path}": ')
    return message.partition('": ')[2]


def write_packed(dataset):
    """Fill a dataset of netCDF4: packed in 16 bits, with an unlimited time of length one."""
    dataset.createDimension("time", None)
    dataset.createDimension("y", len(Y_MM))
    dataset.createDimension("x", len(X_MM))
    for name, values, unit, scale in (("x", X_MM, "um", 1e3), ("y", Y_MM, "m", 1e-3)):
        variable = dataset.createVariable(name, "f4", (name,))
        variable.units = unit
        variable[:] = values * scale
    pressure = dataset.createVariable("pressure_kPa", "i2", ("time", "y", "x"), fill_value=-999)
    pressure.setncatts({"scale_factor": 1e-3, "add_offset": 0.5, "units": "kPa"})
    pressure[0] = PRESSURE


@pytest.mark.parametrize("file_format", FORMATS)
def test_each_format_is_read_packed_and_with_a_time_of_length_one(netcdf4, file_format):
    with netcdf4.Dataset("p.nc", "w", format=file_format) as dataset:
        write_packed(dataset)
    assert_read("p.nc", rel=2e-3)


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("type_code", [">f4", ">f8"])
def test_files_of_scipy_are_read(version, type_code):
    """NetCDF3 is big-endian; the dimensions are in the other order and have other names."""
    with netcdf_file("p.nc", "w", version=version) as dataset:
        dataset.createDimension("column", len(X_MM))
        dataset.createDimension("row", len(Y_MM))
        for name, dimension, values in (("x_mm", "column", X_MM), ("y_mm", "row", Y_MM)):
            dataset.createVariable(name, type_code, (dimension,))[:] = values
        dataset.createVariable("pressure", type_code, ("column", "row"))[:] = PRESSURE.T
    assert_read("p.nc", rel=1e-6)


@pytest.mark.parametrize("engine", ["scipy", "netcdf4", "h5netcdf"])
def test_decreasing_and_shuffled_coordinates_are_sorted(engine):
    module = {"scipy": "scipy", "netcdf4": "netCDF4", "h5netcdf": "h5netcdf"}[engine]
    pytest.importorskip(module)
    data = make_data().isel(x_mm=[2, 1, 0], y_mm=[1, 3, 0, 2])
    data.to_netcdf("p.nc", engine=engine)
    assert_read("p.nc")


def test_big_endian_numbers_of_netcdf4_are_read(netcdf4):
    with netcdf4.Dataset("p.nc", "w") as dataset:
        for name, values in (("x_mm", X_MM), ("y_mm", Y_MM)):
            dataset.createDimension(name, len(values))
            dataset.createVariable(name, ">f8", (name,), endian="big")[:] = values
        variable = dataset.createVariable(
            "pressure", ">f4", ("y_mm", "x_mm"), endian="big", zlib=True
        )
        variable[:] = PRESSURE
    assert_read("p.nc", rel=1e-6)


def test_points_in_a_list_are_arranged_on_their_grid():
    stacked = make_data().stack(point=["x_mm", "y_mm"]).reset_index("point")
    stacked.isel(point=np.random.default_rng(1).permutation(12)).to_netcdf("p.nc")
    assert_read("p.nc")


def test_a_single_group_with_a_pressure_is_read_with_the_coordinates_above_it(netcdf4):
    with netcdf4.Dataset("p.nc", "w") as dataset:
        for name, values in (("x_mm", X_MM), ("y_mm", Y_MM)):
            dataset.createDimension(name, len(values))
            dataset.createVariable(name, "f8", (name,))[:] = values
        group = dataset.createGroup("sensor").createGroup("map")
        group.createVariable("pressure", "f8", ("y_mm", "x_mm"))[:] = PRESSURE
        dataset.createGroup("other").createVariable("temperature", "f8", ("x_mm",))[:] = 20.0
    assert_read("p.nc")
    with netcdf4.Dataset("p.nc", "a") as dataset:
        dataset["other"].createVariable("pressure", "f8", ("y_mm", "x_mm"))[:] = PRESSURE
    assert "/other, /sensor/map; write one" in refuse("p.nc")


def test_missing_pressures_matter_only_under_the_probe(netcdf4):
    """They are those that no one wrote, two special values, and those outside the valid range."""
    with netcdf4.Dataset("p.nc", "w") as dataset:
        for name, values in (("x_mm", np.arange(-5.0, 6.0)), ("y_mm", np.arange(-5.0, 6.0))):
            dataset.createDimension(name, len(values))
            dataset.createVariable(name, "f8", (name,))[:] = values
        pressure = dataset.createVariable("pressure", "i2", ("y_mm", "x_mm"))
        pressure.setncatts({"missing_value": np.int16(777), "valid_max": np.int16(900)})
        pressure.set_auto_mask(False)
        pressure[:] = 100
        pressure[0, 0] = 777
        pressure[0, -1] = 901
        pressure[-1, 0] = -32767
    corners_mm = [[-5.0, -5.0], [5.0, -5.0], [-5.0, 5.0], [5.0, 5.0]]
    found = read_profile("p.nc").pressure(corners_mm)
    assert np.isnan(found).tolist() == [True, True, True, False]
    small = {"shape": "circle", "radius_mm": 3.0}
    scene = Scene().with_(**{"probe": small, "load.profile": "p.nc"})
    scene = scene.with_(**{"numerics.tolerance": 0.05})
    uniform = solve(scene.with_(**{"load.profile": "uniform"})).charges_pC
    assert solve(scene).charges_pC == pytest.approx(uniform, rel=1e-3)
    with pytest.raises(SceneError, match="missing or not finite under the probe"):
        solve(scene.with_(**{"probe.x_mm": 0.0, "probe.radius_mm": 6.9}))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda data: data.rename(pressure="force"),
            'no variable "pressure" but ',
        ),
        (lambda data: data.drop_vars("x_mm"), 'has no variable "x_mm"'),
        (lambda data: data.rename(x_mm="x"), 'has x with units = ""; give a unit of length'),
        (lambda data: data.assign_coords(x_mm=data.x_mm.assign_attrs(units="m")), "differs from"),
        (lambda data: data.assign_coords(x_mm=data.x_mm.assign_attrs(units="K")), 'units = "K"'),
        (lambda data: data.expand_dims(time=2), "time = 2, y_mm = 4, x_mm = 3; select one value"),
        (lambda data: data.isel(x_mm=[0]), "at least two values along x_mm"),
        (lambda data: data.isel(x_mm=[0, 0, 1]), "repeated values of x_mm or y_mm"),
        (lambda data: data.assign_coords(x_mm=[0.0, np.nan, 2.0]), "missing or infinite values"),
        (lambda data: data.astype(str), "write it as real numbers"),
        (lambda data: data.assign(pressure_Pa=data.pressure).drop_vars("pressure"), None),
        (lambda data: data.assign(X_m=data.x_mm / 1e3), None),
    ],
)
def test_files_without_a_pressure_on_a_grid_are_refused_with_a_cure(change, words):
    """The last two are read: names with a unit, and a preferred name beside another."""
    change(make_data(units="Pa")).to_netcdf("p.nc", engine="scipy")
    if words is None:
        assert_read("p.nc")
    else:
        assert words in refuse("p.nc")


def test_several_names_for_one_coordinate_are_refused():
    data = make_data().rename(x_mm="x")
    data = data.assign_coords(x=data.x.assign_attrs(units="mm"), X_m=data.x / 1e3)
    data.to_netcdf("p.nc", engine="scipy")
    assert 'several variables for "x_mm", ' in refuse("p.nc")


@pytest.mark.parametrize("size", [3, 200])
def test_damaged_files_are_refused(size):
    make_data().to_netcdf("whole.nc", engine="scipy")
    Path("p.nc").write_bytes(Path("whole.nc").read_bytes()[:size])
    message = refuse("p.nc")
    assert message.startswith("is not a NetCDF file" if size == 3 else "cannot be read as NetCDF")


def test_hdf5_without_named_dimensions_is_refused(netcdf4):
    h5py = pytest.importorskip("h5py")
    with h5py.File("p.nc", "w") as file:
        file["x_mm"] = X_MM
        file["y_mm"] = Y_MM
        file["pressure"] = PRESSURE
    assert "HDF5 without named dimensions" in refuse("p.nc")


@pytest.mark.parametrize(
    ("signature", "title"), [(b"CDF\x05", "CDF-5"), (b"\x89HDF\r\n\x1a\n", "NetCDF4")]
)
def test_formats_without_a_reader_are_refused_with_what_to_install(monkeypatch, signature, title):
    """The content decides, whatever the name."""
    find = importlib.util.find_spec
    absent = ("netCDF4", "h5netcdf")
    monkeypatch.setattr(
        "pvdf_fem.readings.netcdf.find_spec", lambda name: None if name in absent else find(name)
    )
    for name in ("p.nc", "p.csv"):
        Path(name).write_bytes(signature + bytes(100))
        message = refuse(name)
        assert title in message
        assert 'which is not installed; run: pip install "pvdf-fem[netcdf]"' in message
