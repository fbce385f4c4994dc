"""All proofs, in the order of the guide's page "How good is it?"."""

from __future__ import annotations

from tests.validation import backings, calculix, charges, membranes, outlines, vibrations
from tests.validation.proof import Proof

PROOFS = [
    found
    for module in (membranes, outlines, backings, vibrations, charges, calculix)
    for found in vars(module).values()
    if isinstance(found, Proof)
]
