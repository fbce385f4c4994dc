"""All corpora of damaged inputs; a new one is a function beside this module and a line here."""

from __future__ import annotations

from reports.robustness import charge_inputs, inputs, model_inputs, sweep_inputs
from reports.robustness.inputs import Corpus

#: Corpora with the relative numbers of their inputs.
CORPORA: dict[Corpus, float] = {
    inputs.wrong_value: 4.0,
    inputs.wrong_change: 2.0,
    inputs.unknown_key: 1.0,
    inputs.damaged_scene: 7.0,
    inputs.damaged_change: 2.0,
    inputs.wrong_sweep: 2.0,
    inputs.damaged_sweep: 3.0,
    inputs.wrong_option: 0.5,
    inputs.damaged_store: 0.5,
    charge_inputs.wrong_charges: 1.0,
    charge_inputs.damaged_charges: 1.0,
    model_inputs.damaged_model: 2.0,
    model_inputs.wrong_model: 2.0,
    model_inputs.foreign_model: 0.5,
    model_inputs.foreign_store: 0.5,
    sweep_inputs.hostile_sweep: 2.0,
    sweep_inputs.valid_sweep: 1.0,
}
