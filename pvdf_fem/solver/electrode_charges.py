"""The charges of a scene's electrodes with errors, and the readings and voltages they cause."""

from __future__ import annotations

from abc import abstractmethod

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.channel import compute_readings_V, make_channels
from pvdf_fem.electrodes.heat import compute_heat_charges
from pvdf_fem.electrodes.stress_integrals import StressIntegrals
from pvdf_fem.electrodes.thickness import compute_thickness_charges
from pvdf_fem.film.coupling import find_floating_electrodes
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.arguments import ValuesByName, coerce_array
from pvdf_fem.scene.scene import Scene, SceneError
from pvdf_fem.solver.discrete_solution import DiscreteSolution
from pvdf_fem.summary import Result

#: Names of the properties of `ElectrodeCharges` with charges or errors of charges in pC.
CHARGE_PROPERTIES = (
    "charges_pC",
    "charge_errors_pC",
    "rest_charges_pC",
    "rest_charge_errors_pC",
    "charge_changes_pC",
    "charge_change_errors_pC",
)


class ElectrodeCharges(Result):
    """Base class of solutions, with charges, readings and voltages by electrode.

    Attributes
    ----------
    problem : Problem
        The problem that was solved.
    unloaded_integrals : StressIntegrals or None
        Stress integrals of the electrodes on the unloaded film; None if it has no result.
    """

    problem: Problem
    unloaded_integrals: StressIntegrals | None

    @property
    @abstractmethod
    def discrete(self) -> DiscreteSolution:
        """The converged solution on its mesh."""

    @property
    def scene(self) -> Scene:
        """The scene that was solved."""
        return self.problem.scene

    @property
    def charges_pC(self) -> dict[str, float]:
        """Total charge in pC by electrode.

        The charge is caused by the stress of pretension and load, and, if the film has coefficients
        for them, also by the heat (pyroelectric) and the pressure of the probe (d33).
        """
        film = self.scene.film
        discrete = self.discrete
        charges = discrete.stress_integrals.charges(self._coefficients_pC_N)
        if film.pyroelectric_uC_m2K is not None:
            charges += 1e12 * compute_heat_charges(self.problem, discrete.solved)
        if film.d33_pC_N is not None:
            charges += 1e12 * compute_thickness_charges(discrete.equilibrium, discrete.state)
        return self._map_electrodes_to_values(charges)

    @property
    def charge_errors_pC(self) -> dict[str, float]:
        """Estimated absolute error of each of `charges_pC`, in pC.

        It is the discretisation error of the charge due to stress, or the change that wrinkles
        would cause if that is larger. Real films wrinkle where a membrane would be compressed.
        """
        return self.charge_errors_by(*self._coefficients_pC_N)

    @property
    def rest_charges_pC(self) -> dict[str, float]:
        """Charges in pC by electrode of the film without load and without heat from the probe.

        If the unloaded film has no result, a warning says so, and these charges and
        `charge_changes_pC` are NaN.
        """
        return self._map_electrodes_to_values(self._unloaded.charges(self._coefficients_pC_N))

    @property
    def rest_charge_errors_pC(self) -> dict[str, float]:
        """Estimated absolute error in pC of each of `rest_charges_pC`; NaN if the charge is NaN."""
        return self._map_electrodes_to_values(self._unloaded.charge_errors(self._coefficients_pC_N))

    @property
    def charge_changes_pC(self) -> dict[str, float]:
        """Charge in pC that the load adds, by electrode.

        A charge amplifier that is zeroed before the load measures this charge.
        """
        unloaded = self.rest_charges_pC
        return {name: charge - unloaded[name] for name, charge in self.charges_pC.items()}

    @property
    def charge_change_errors_pC(self) -> dict[str, float]:
        """Estimated absolute error in pC of each of `charge_changes_pC`.

        It is the sum of the errors with and without load.
        """
        unloaded = self.rest_charge_errors_pC
        return {name: error + unloaded[name] for name, error in self.charge_errors_pC.items()}

    @property
    def _unloaded(self) -> StressIntegrals:
        """Stress integrals of the unloaded film; NaN if it has no result."""
        if self.unloaded_integrals is None:
            return StressIntegrals.unknown(len(self.scene.electrode_list))
        return self.unloaded_integrals

    @property
    def _coefficients_pC_N(self) -> tuple[float, float]:
        """The film's d31 and d32 in pC/N."""
        return self.scene.film.d31_pC_N, self.scene.film.d32_pC_N

    @property
    def readings_V(self) -> dict[str, float]:
        """Reading in V of each channel of ``[readout]`` just after a sudden load, by electrode.

        It then decays with the channel's time constant, see
        `pvdf_fem.electrodes.channel.Channel`. `SceneError` is raised without ``[readout]``.
        """
        if self.scene.readout is None:
            raise SceneError(["readout: is required for readings; add [readout]"])
        charges = list(self.charges_pC.values())
        changes = list(self.charge_changes_pC.values())
        return self._map_electrodes_to_values(compute_readings_V(self.scene, charges, changes))

    @property
    def electrode_voltages_V(self) -> dict[str, float]:
        """Voltage in V of each electrode just after a sudden load, before any amplifier.

        It is zero with a charge amplifier. Otherwise it is the change of the charge divided by the
        capacitance of electrode and cable.
        """
        capacitances = {channel.name: channel.capacitance for channel in make_channels(self.scene)}
        floating = {electrode.name for electrode in find_floating_electrodes(self.scene)}
        voltages = dict.fromkeys(capacitances, 0.0)
        for name, change_pC in self.charge_changes_pC.items():
            if name in floating:
                voltages[name] = 1e-12 * change_pC / capacitances[name]
        return voltages

    def charges_by(self, d31_pC_N: float, d32_pC_N: float) -> dict[str, float]:
        """Compute the charges for other piezoelectric coefficients, without solving again.

        Parameters
        ----------
        d31_pC_N, d32_pC_N : float
            Piezoelectric coefficients in pC/N.

        Returns
        -------
        dict
            Charge in pC by electrode, without the charges caused by heat and by d33.
        """
        coefficients = coerce_array("d31_pC_N, d32_pC_N", [d31_pC_N, d32_pC_N])
        return self._map_electrodes_to_values(self.discrete.stress_integrals.charges(coefficients))

    def charge_errors_by(self, d31_pC_N: float, d32_pC_N: float) -> dict[str, float]:
        """Compute the estimated absolute errors in pC of `charges_by`, by electrode."""
        coefficients = (d31_pC_N, d32_pC_N)
        return self._map_electrodes_to_values(
            self.discrete.stress_integrals.charge_errors(coefficients)
        )

    def _map_electrodes_to_values(self, values: Array) -> dict[str, float]:
        """Return a mapping of electrode names to values, given in the scene's order."""
        names = [electrode.name for electrode in self.scene.electrode_list]
        return ValuesByName(zip(names, values.tolist(), strict=True))
