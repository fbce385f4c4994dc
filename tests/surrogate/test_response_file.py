"""Files of responses: what was written is read, and nothing else."""

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
from tests.surrogate import random_response as kept


def test_a_response_survives_a_file(tmp_path):
    """And numbers of any type: a response that takes minutes must not be lost for the type of an
    argument of its build."""
    domain = Domain(np.int64(8), [np.float32(0.5), 5])
    made = replace(kept.response(), domain=domain, error_bound=np.float32(0.25), remarks=("a",))
    made.save(tmp_path / "triangle.response")
    again = Response.load(str(tmp_path / "triangle.response"))
    assert (again.domain, again.error_bound) == (Domain(8.0, (0.5, 5.0)), 0.25)
    names = ("names", "scene", "tolerance", "remarks", "stress_modes", "unloaded_charges_pC")
    assert [getattr(again, name) for name in names] == [getattr(made, name) for name in names]
    made, touches = replace(made, domain=again.domain), [[1.0, -2.0, 33.0, 1.5]]
    for before, after in zip(made.evaluate(touches), again.evaluate(touches), strict=True):
        np.testing.assert_array_equal(before, after)
    assert os.listdir(tmp_path) == ["triangle.response"]


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return tmp_path_factory.mktemp("damaged") / "a.response"


@given(data=damages(kept.response_bytes(), decayed))
@example(data=b"")
@example(data=FORMAT)
@example(data=b"\x93NUMPY\x01\x00" + bytes(128))
@example(data=kept.response().scene.to_toml().encode())
@drawn(0.5)
def test_damage_is_found_wherever_it_is_and_other_files_are_told_apart(data, path):
    path.write_bytes(data)
    if data == kept.response_bytes():  # two accidents may cancel
        return
    with pytest.raises(ResponseError) as caught:
        Response.load(path)
    (line,) = str(caught.value).splitlines()
    assert line.startswith(f"{path}: ")
    assert len(line) < len(str(path)) + 300
