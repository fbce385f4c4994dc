"""The charge that sampling loses where a touch begins.

Where a resistance takes the charge away within a sample or so, samples tell the rate at which
charge comes. It may be steep at first: charges grow as the force to the power 2/3, so that a force
that begins at a finite rate brings a sixth of the charges of a tap of 50 ms within the first of 50
samples. The circuit's answer to a smooth course of the force from zero is fitted to the first
samples, and what the sum over samples misses of its charge is added.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from pvdf_fem.arrays import Array
from pvdf_fem.response.model import FORCE
from pvdf_fem.tracking.circuit import ChargeSum
from pvdf_fem.tracking.course import LIGHTEST, ChangeModel

#: Points of the course of the force, which are dense where it begins, and of the law of charges.
POINTS = 80
#: What is likely before: the power of the time by which forces begin, and its deviation; and the
#: deviations of the curvature, of the beginning in samples, and of the logarithm of the force.
POWER = 1.4
SPREADS = np.array([3.0, 0.5, 0.5, 1.0])
#: Searches start from the best of these, added to what is likely.
BEGINS = (-1.0, -0.5, 0.0, 0.5, 1.0)
POWERS = (-0.4, 0.1, 0.6)
MISFIT = 0.01  #: Part of a voltage by which such a course may differ from the true one.
DOUBT = 0.5  #: Share of the charge missed that is in doubt, as the course may be another.
BEGUN = 0.01  #: The touch has begun where this share of its squared voltages has come.


def missed_charge(
    model: ChangeModel, at: Array, times: Array, voltages: Array, noise: Array
) -> tuple[Array, float]:
    """What a `ChargeSum` over the first samples of a touch misses, and how well that is known. For
    a touch near coordinates `at` (4,), at times (n,) in s with voltages (n, electrodes) over the
    baseline, NaN where a channel was lost. The course of the force is f (t - t0)^p exp(c t), with
    t0, f, p and c fitted. Returns charges (electrodes,) in pC, and the standard deviation of this
    over the charge at the last time."""
    errors = np.hypot(noise, MISFIT * np.abs(voltages))
    weights = np.where(np.isnan(voltages), 0.0, 1.0 / errors)
    measured = np.nan_to_num(voltages) * weights
    power = np.cumsum(np.square(measured).sum(axis=1))
    first = max(int(np.searchsorted(power, BEGUN * power[-1])) - 1, 0)
    end, step = times[-1], (times[-1] - times[0]) / len(times)
    law = np.tile(at, (2 * POINTS, 1))
    bounds = model.least - LIGHTEST, model.model.domain.log_force[1]
    law[:, FORCE] = np.linspace(*bounds, len(law))
    charges_by_force = model.linearised(law)[:, :, 0].T

    def course(values: Array) -> tuple[Array, Array]:
        """Charges at the last time, and voltages."""
        start = min(times[first] + values[0] * step, end - step)
        nodes = start + (end - start) * np.linspace(0.0, 1.0, POINTS) ** 2
        nodes = np.unique(np.concatenate([nodes, times]))
        since = np.maximum((nodes - start) / (end - start), 1e-9)
        log_force = at[FORCE] + values[1] + values[2] * np.log(since) + values[3] * (since - 1.0)
        charges = np.array([np.interp(log_force, law[:, FORCE], q) for q in charges_by_force]).T
        charges *= (nodes > start)[:, None]
        return charges[-1], model.circuit.response(nodes, charges, np.searchsorted(nodes, times))

    def residuals(values: Array) -> Array:
        voltage_misfit = (course(values)[1] * weights - measured).ravel()
        return np.concatenate([voltage_misfit, (values - likely) / SPREADS])

    def missed(values: Array) -> Array:
        charge, predicted = course(values)
        total, summed = ChargeSum(model.circuit, times[0], np.zeros_like(charge)), charge
        for time, voltage in zip(times[1:].tolist(), predicted[1:], strict=True):
            summed = total.add(time, voltage, np.zeros_like(charge))
        return charge - summed

    likely = np.array([0.5, 0.0, POWER, 0.0])
    starts = [likely + np.array([begin, 0.0, power, 0.0]) for begin in BEGINS for power in POWERS]
    costs = [np.square(residuals(start)).sum() for start in starts]
    start = starts[int(np.argmin(costs))]
    found = least_squares(residuals, start, method="lm", x_scale=0.1 * SPREADS, diff_step=1e-4)
    best, root = missed(found.x), np.linalg.cholesky(np.linalg.inv(found.jac.T @ found.jac))
    changes = np.array([missed(found.x + 0.3 * way) - best for way in root.T]) / 0.3
    error = np.hypot(np.linalg.norm(changes), DOUBT * np.linalg.norm(best))
    return best, float(error / np.linalg.norm(course(found.x)[0]))
