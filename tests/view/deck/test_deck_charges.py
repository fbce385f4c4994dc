"""Charges from stresses that a program prints, and reading its results."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pvdf_fem.files import FileError
from pvdf_fem.view.deck.calculix_results import CalculixResults
from pvdf_fem.view.deck.deck_charges import convert_cauchy_stress

SMALL = arrays(float, (1, 3, 2), elements=st.floats(-0.4, 0.4))
STRESS = arrays(float, (1, 3), elements=st.floats(-1e7, 1e7))


@given(gradient=SMALL, stress=STRESS, thickness_strain=st.floats(-0.1, 0.1))
def test_cauchy_stress_of_a_known_stress_is_converted_back(gradient, stress, thickness_strain):
    """σ = F S Fᵀ/J by the full deformation gradient, with the deformed normal as third column."""
    stretch = np.sqrt(1.0 + 2.0 * thickness_strain)
    in_plane = gradient[0] + np.eye(3)[:, :2]
    normal = np.cross(in_plane[:, 0], in_plane[:, 1])
    F = np.column_stack([in_plane, stretch * normal / np.linalg.norm(normal)])
    S = np.zeros((3, 3))
    S[:2, :2] = np.array([[stress[0, 0], stress[0, 2]], [stress[0, 2], stress[0, 1]]])
    sigma = F @ S @ F.T / np.linalg.det(F)
    printed = [sigma[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    found = convert_cauchy_stress(np.array([printed]), gradient, np.array([thickness_strain]))
    np.testing.assert_allclose(found, stress, rtol=1e-9, atol=1e-3)


DAT = """

 displacements (vx,vy,vz) for set NODES and time  0.1000000E+01

         1  0.000000E+00  0.000000E+00  0.000000E+00

 displacements (vx,vy,vz) for set NODES and time  0.2000000E+01

         1  1.000000E-03 -2.000000E-03  3.000000E-03

 stresses (elem, integ.pnt.,sxx,syy,szz,sxy,sxz,syz) for set ELECTRODE_A and time  0.2000000E+01

         7   1  1.000000E+06  2.000000E+06  0.000000E+00  3.000000E+00  0.000000E+00  0.000000E+00
         7   2  3.000000E+06  2.000000E+06  0.000000E+00 3.000000E+00  0.000000E+00  0.000000E+00 _s

 strains (elem, integ.pnt.,exx,eyy,ezz,exy,exz,eyz) for set ELECTRODE_A and time  0.2000000E+01

         7   1  1.000000E-03  2.000000E-03 -4.000000E-03  0.000000E+00  0.000000E+00  0.000000E+00
         7   2  1.000000E-03  2.000000E-03 -2.000000E-03  0.000000E+00  0.000000E+00  0.000000E+00

 forces (fx,fy,fz) for set RIM and time  0.2000000E+01

         1  1.000000E+00  1.000000E+00  1.000000E+00
"""


def test_results_are_those_at_the_end_averaged_over_integration_points(tmp_path):
    path = tmp_path / "film.dat"
    path.write_text(DAT)
    results = CalculixResults.read(path)
    assert results.select_displacements(np.array([0])).tolist() == [[1e-3, -2e-3, 3e-3]]
    assert results.select_stresses(np.array([6])).tolist() == [[2e6, 2e6, 0, 3, 0, 0]]
    assert results.select_thickness_strains(np.array([6])) == pytest.approx([-3e-3])
    with pytest.raises(FileError, match=r"film\.dat"):
        results.select_stresses(np.array([1]))


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.dat", ""),
        ("a.dat", DAT.split(" strains")[0]),
        ("a.dat", DAT.replace("1.000000E-03 -2.000000E-03", "NaN NaN")),
        ("a.dat", DAT.replace("3.000000E-03\n", "\n")),
        ("a.frd", DAT),
    ],
)
def test_unfinished_results_are_refused(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    with pytest.raises(FileError, match=name.replace(".", r"\.")):
        CalculixResults.read(tmp_path / name)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(FileError):
        CalculixResults.read(tmp_path / "a.dat")
