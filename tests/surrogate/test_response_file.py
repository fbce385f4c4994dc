"""Files of responses are read as they were written, and damaged ones are rejected."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given

from pvdf_fem import Response
from pvdf_fem.surrogate.response_file import FORMAT, ResponseError
from pvdf_fem.surrogate.touch_domain import Domain
from tests.helpers.damage import damages, decayed, drawn
from tests.surrogate.random_response import make_response, make_response_bytes


def test_a_response_is_read_as_it_was_written(tmp_path):
    """Numbers of any type are saved: no response must be lost by the type of an argument."""
    domain = Domain(np.int64(8), [np.float32(0.5), 5])
    made = replace(make_response(), domain=domain, error_bound=np.float32(0.25), notes=("a",))
    made.save(tmp_path / "triangle.response")
    again = Response.load(str(tmp_path / "triangle.response"))
    assert (again.domain, again.error_bound) == (Domain(8.0, (0.5, 5.0)), 0.25)
    names = ("names", "scene", "tolerance", "notes", "stress_modes", "unloaded_charges_pC")
    assert [getattr(again, name) for name in names] == [getattr(made, name) for name in names]
    made, touches = replace(made, domain=again.domain), [[1.0, -2.0, 33.0, 1.5]]
    for before, after in zip(made.evaluate(touches), again.evaluate(touches), strict=True):
        np.testing.assert_array_equal(before, after)
    assert os.listdir(tmp_path) == ["triangle.response"]


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return tmp_path_factory.mktemp("damaged") / "a.response"


@given(data=damages(make_response_bytes(), decayed))
@example(data=b"")
@example(data=FORMAT)
@example(data=b"\x93NUMPY\x01\x00" + bytes(128))
@example(data=make_response().scene.to_toml().encode())
@drawn(0.5)
def test_damaged_and_other_files_are_rejected(data, path):
    path.write_bytes(data)
    if data == make_response_bytes():  # two accidents may cancel
        return
    with pytest.raises(ResponseError) as caught:
        Response.load(path)
    (line,) = str(caught.value).splitlines()
    assert line.startswith(f"{path}: ")
    assert len(line) < len(str(path)) + 300
