"""Places from charges: exact on circles, every ambiguity listed, every failure named."""

import numpy as np
import pytest

from reports.maps.isocharge import contour
from reports.thesis_methods.triangulation import PlaceStatus, fit_place, triangulate
from tests.helpers.sensing_cases import Peak

THREE = {"A": Peak(0.0, -10.0), "B": Peak(8.66, 5.0), "C": Peak(-8.66, 5.0)}
FOUR = {"A": Peak(10.0, 0.0), "B": Peak(0.0, 10.0), "C": Peak(-10.0, 0.0), "D": Peak(0.0, -10.0)}
ON_A_LINE = {"A": Peak(-8.0, 0.0), "B": Peak(1.0, 0.0), "C": Peak(8.0, 0.0)}
PLACE = np.array([3.0, -1.5])


def radii(peaks, place=PLACE):
    return {name: float(np.hypot(*(place - [p.x_mm, p.y_mm]))) for name, p in peaks.items()}


def contours(peaks, radii_mm):
    return [peak.circle(name, radii_mm[name]) for name, peak in peaks.items()]


def charges(peaks, place=PLACE):
    return {name: peak.charge(place) for name, peak in peaks.items()}


# ---------------------------------------------------------------------------- the thesis's rule


def test_three_contours_through_a_place_locate_it():
    found = triangulate(contours(THREE, radii(THREE)))
    (triangle,) = found.triangles
    assert found.status is triangle.status is PlaceStatus.LOCATED
    assert found.position_mm == pytest.approx(PLACE, abs=1e-4)
    assert triangle.spread_mm < 2e-4


def test_every_choice_of_crossings_is_listed():
    """Each two circles cross twice, so that there are eight triples of crossings."""
    (triangle,) = triangulate(contours(THREE, radii(THREE))).triangles
    assert [len(pair.crossings_mm) for pair in triangle.pairs] == [2, 2, 2]
    spreads = [candidate.spread_mm for candidate in triangle.candidates]
    assert len(spreads) == 8
    assert spreads == sorted(spreads)
    assert spreads[1] > 1.0


def test_electrodes_on_a_line_leave_two_places():
    (triangle,) = triangulate(contours(ON_A_LINE, radii(ON_A_LINE))).triangles
    first, second, third = triangle.candidates[:3]
    assert max(first.spread_mm, second.spread_mm) < 1e-3 < third.spread_mm
    below, above = sorted([first.mean_mm, second.mean_mm], key=lambda place: place[1])
    assert below == pytest.approx([3.0, -1.5], abs=1e-4)
    assert above == pytest.approx([3.0, 1.5], abs=1e-4)


def test_the_mean_of_three_crossings():
    """One radius off: the place is the mean of the corners of the small triangle."""
    wrong = radii(THREE) | {"A": radii(THREE)["A"] + 0.2}
    (triangle,) = triangulate(contours(THREE, wrong)).triangles
    corners = triangle.candidates[0].corners_mm
    for (a, b), corner in zip(("AB", "AC", "BC"), corners, strict=True):
        for name in (a, b):
            centre = [THREE[name].x_mm, THREE[name].y_mm]
            assert np.linalg.norm(corner - centre) == pytest.approx(wrong[name], abs=1e-5)
    assert triangle.position_mm == pytest.approx(corners.mean(axis=0))
    longest = max(np.linalg.norm(a - b) for a in corners for b in corners)
    assert triangle.spread_mm == pytest.approx(longest)
    assert 0.1 < np.linalg.norm(corners - PLACE, axis=1).max() < 1.0


def test_pairs_that_do_not_cross_are_named_with_their_gap():
    """Circles of 5 mm about A, of 5 mm about B, 17.32 mm apart; C's circle crosses B's only."""
    found = triangulate(contours(THREE, {"A": 5.0, "B": 5.0, "C": 14.0}))
    (triangle,) = found.triangles
    assert found.status is triangle.status is PlaceStatus.NO_CROSSING
    assert triangle.candidates == ()
    assert np.isnan(found.position_mm).all()
    assert np.isnan(found.spread_mm)
    gap = np.hypot(8.66, 15.0) - 10.0
    ab = triangle.pairs[0]
    assert ab.electrodes == ("A", "B")
    # chords of 0.1 mm leave circles of 5 mm by 0.1² / (8 x 5) mm
    assert ab.gap_mm == pytest.approx(gap, abs=2 * 0.1**2 / 40.0)
    # the polylines come closest at corners, up to half a chord aside
    assert ab.nearest_mm.mean(axis=0) == pytest.approx([4.33, -2.5], abs=0.05)
    assert triangle.reasons == ("A-B pass at 7.32 mm",)
    assert found.reason == "A-B pass at 7.32 mm"
    assert triangle.pairs[1].gap_mm == 0.0


def test_a_charge_without_a_contour_is_named():
    found = triangulate([*contours(THREE, radii(THREE))[:2], Peak(0.0, 0.0).circle("C", 90.0)])
    assert found.status is PlaceStatus.NO_CONTOUR
    assert found.reason == "C has 2.577e-15 pC nowhere"
    assert np.isnan(found.triangles[0].pairs[1].gap_mm)


def test_four_contours_give_the_mean_of_four_triples():
    off = {"A": 0.1, "B": -0.1, "C": 0.05, "D": 0.0}
    found = triangulate(contours(FOUR, {n: r + off[n] for n, r in radii(FOUR).items()}))
    assert [t.electrodes for t in found.triangles] == [
        tuple(n) for n in ("ABC", "ABD", "ACD", "BCD")
    ]
    places = [t.position_mm for t in found.triangles]
    assert found.position_mm == pytest.approx(np.mean(places, axis=0))
    assert np.ptp(places, axis=0).max() > 0.01
    assert found.spread_mm >= max(t.spread_mm for t in found.triangles)


def test_contours_that_nearly_touch_meet_midway_if_that_is_asked_for():
    """Circles of 5 mm about A and B leave a gap of 0.02 mm, which the circle about C passes."""
    peaks = {"A": Peak(-5.01, 0.0), "B": Peak(5.01, 0.0), "C": Peak(0.0, -7.0)}
    known = contours(peaks, {"A": 5.0, "B": 5.0, "C": 7.0})
    assert triangulate(known, 0.01).status is PlaceStatus.NO_CROSSING
    found = triangulate(known, 0.03)
    assert found.status is PlaceStatus.LOCATED
    # along the contours to half a sample
    assert found.triangles[0].candidates[0].corners_mm[0] == pytest.approx([0.0, 0.0], abs=0.05)


def test_triples_that_fail_do_not_enter_the_mean():
    """As in section 3.2.2, where two of four triples were left. C's circle is too small.

    Of 3 mm about (-10, 0) it stays 9.84 mm from that about A and 2.13 mm from that about D, and
    crosses that of 11.88 mm about B.
    """
    found = triangulate(contours(FOUR, radii(FOUR) | {"C": 3.0}))
    assert [t.electrodes for t in found.located] == [("A", "B", "D")]
    assert found.status is PlaceStatus.LOCATED
    assert found.position_mm == pytest.approx(PLACE, abs=1e-4)
    assert found.reason == "A-C pass at 9.84 mm; C-D pass at 2.13 mm"


def test_two_contours_are_too_few():
    with pytest.raises(ValueError, match="of A, B only"):
        triangulate(contours(THREE, radii(THREE))[:2])


# --------------------------------------------------------------------------------- least squares


@pytest.mark.parametrize("peaks", [THREE, FOUR])
def test_least_squares_find_the_place(peaks):
    found = fit_place(charges(peaks), peaks)
    assert found.status is PlaceStatus.LOCATED
    assert found.position_mm == pytest.approx(PLACE, abs=1e-6)
    assert found.fixes[0].misfit_pC < 1e-6
    assert all(fix.misfit_pC > 10.0 for fix in found.fixes[1:])


def test_least_squares_list_both_places_of_electrodes_on_a_line():
    first, second, *others = fit_place(charges(ON_A_LINE), ON_A_LINE).fixes
    assert max(first.misfit_pC, second.misfit_pC) < 1e-6
    assert sorted([first.position_mm[1], second.position_mm[1]]) == pytest.approx([-1.5, 1.5])
    assert all(fix.misfit_pC > 1.0 for fix in others)


def test_least_squares_give_a_place_where_contours_do_not_cross():
    """The charges of every second electrode 10 % too large."""
    wrong = {n: q * (1.1 if n in "AC" else 1.0) for n, q in charges(FOUR).items()}
    found = fit_place(wrong, FOUR)
    assert np.linalg.norm(found.position_mm - PLACE) < 2.0
    assert found.fixes[0].misfit_pC > 10.0


def test_the_deviation_of_a_place_follows_the_slopes():
    """At (0, 0) two peaks at right angles: slopes 60.65 pC/mm along x and along y."""
    two = {"A": Peak(10.0, 0.0), "B": Peak(0.0, 10.0)}
    places = fit_place(charges(two, np.zeros(2)), two).fixes
    fix = min(places, key=lambda fix: np.linalg.norm(fix.position_mm))
    slope = 1000.0 * np.exp(-0.5) / 10.0
    assert fix.deviation_mm(1.0) == pytest.approx(1.0 / slope, rel=1e-4)
    assert fix.deviation_mm(3.0) == pytest.approx(3.0 / slope, rel=1e-4)


def test_contours_that_nearly_touch_need_least_squares():
    """A and C on opposite sides of the place, B aside; A's charge 3 pC too small.

    A's circle is 0.05 mm too large then, and meets C's, of 11 mm too, at (±√(11 · 0.05), 1).
    """
    peaks = {"A": Peak(0.0, -10.0), "B": Peak(10.0, 2.0), "C": Peak(0.0, 12.0)}
    place = np.array([0.05, 1.0])
    wrong = charges(peaks, place)
    wrong["A"] -= 3.0
    by_mean = triangulate([contour(name, peak, wrong[name]) for name, peak in peaks.items()])
    by_squares = fit_place(wrong, peaks)
    assert np.linalg.norm(by_mean.position_mm - place) > 0.2
    assert by_mean.spread_mm > 0.6
    assert np.linalg.norm(by_squares.position_mm - place) < 0.03


def test_charges_of_a_place_beyond_the_reach_are_outside():
    small = {name: Peak(p.x_mm, p.y_mm, reach_mm=6.0) for name, p in THREE.items()}
    found = fit_place(charges(THREE, np.array([14.0, 9.0])), small)
    assert found.status is PlaceStatus.OUTSIDE
    assert np.isnan(found.position_mm).all()


@pytest.mark.parametrize(
    ("given", "message"), [({"A": 1.0}, "needs two"), ({"A": 1.0, "X": 2.0}, "no charge map of X")]
)
def test_charges_that_cannot_be_used_are_refused(given, message):
    with pytest.raises(ValueError, match=message):
        fit_place(given, THREE)
