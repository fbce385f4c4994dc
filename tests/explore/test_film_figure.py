"""The film as a figure of the page."""

import numpy as np
import pytest

pytest.importorskip("bokeh")

from pvdf_fem.explore.film_figure import FilmFigure


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_film_is_palest_where_it_stays(sign):
    film = FilmFigure()
    film.show_image(sign * np.array([[0.0, 2.0], [1.0, np.nan]]), 45.0, "deflection")
    film.show_scale("deflection")
    assert sorted([film.colours.low, film.colours.high], key=abs) == [0.0, 2.0 * sign]
    first, last = (sum(bytes.fromhex(film.colours.palette[i][1:])) for i in (0, -1))
    assert sign * (first - last) > 0.0
    pixels = film.sources["image"].data["image"][0].view(np.uint8).reshape(2, 2, 4)
    assert pixels[..., 3].tolist() == [[255, 255], [255, 0]]  # the film is not where it is NaN
    ends = [bytes(pixels[0, i, :3]).hex() for i in (0, 1)]
    zero, most = (0, -1) if sign > 0.0 else (-1, 0)
    assert ends == [film.colours.palette[i][1:].lower() for i in (zero, most)]
