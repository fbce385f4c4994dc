"""The page of proof: numbers that others know, each within its tolerance."""

from __future__ import annotations

import pytest

from tests.validation.proofs import PROOFS


@pytest.mark.parametrize("proof", PROOFS, ids=lambda proof: proof.problem)
def test_numbers_are_those_of_the_source(proof):
    numbers = list(proof.numbers())
    assert numbers
    assert not [number for number in numbers if not abs(number.difference) <= number.tolerance]
