"""The film as a figure of the page."""

import numpy as np
import pytest

pytest.importorskip("bokeh")

from pvdf_fem.explore.film_figure import FilmFigure


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_film_is_palest_where_it_stays(sign):
    film = FilmFigure()
    film.show_image(sign * np.array([[0.0, 2.0], [1.0, 0.5]]), 45.0, "deflection")
    assert sorted([film.colours.low, film.colours.high], key=abs) == [0.0, 2.0 * sign]
    first, last = (sum(bytes.fromhex(film.colours.palette[i][1:])) for i in (0, -1))
    assert sign * (first - last) > 0.0
