"""Sizes that resolve the layers in which bending acts."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem.film.layers import Layers, remaining_part


@pytest.mark.parametrize("reduction", [0.5, 0.7, 0.9])
def test_sizes_leave_what_was_asked_for(reduction):
    """Elements of all widths and effects; those that leave little stay."""
    random = np.random.default_rng(1)
    lengths, widths, effects = 10.0 ** random.uniform(
        [[-3], [-1], [-4]], [[0], [1.3], [0]], (3, 500)
    )
    wanted = reduction * (effects * remaining_part(widths)).sum()
    sizes = Layers(None, None, lengths, widths, np.empty(0)).sizes(effects, wanted)
    now = effects * remaining_part(np.minimum(sizes / lengths, widths))
    assert 0.5 * wanted <= now.sum() <= wanted * (1.0 + 1e-3)
    assert np.isinf(sizes).any()
