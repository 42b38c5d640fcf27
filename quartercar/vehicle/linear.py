"""LinearCar: the quarter car with springs and a viscous damper, its responses, those to a random road too."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lpvid.errors import InputError, NumericalError
from lpvid.toolkit import checks
from quartercar.parameters import CarParameters
from quartercar.roads import iso_roughness

if TYPE_CHECKING:
    import control

OUTPUTS = {"body_acceleration": "m/s^2", "suspension_deflection": "m", "tyre_deflection": "m", "tyre_force": "N",
           "suspension_velocity": "m/s", "body_velocity": "m/s", "wheel_velocity": "m/s",
           "body_displacement": "m", "wheel_displacement": "m"}
"""Every output of a quarter car with its unit; tyre and suspension about the static equilibrium."""
RELATIVE = tuple(OUTPUTS)[:7]
"""Outputs of the relative state order."""
GRAVITY = 9.81
"""g [m/s²]"""


@dataclass(frozen=True, eq=False)
class StateSpace:
    """ẋ = A x + B u, y = C x + D u, continuous, with every signal named.

    Attributes
    ----------
    A, B, C, D : arrays
    states, inputs, outputs : tuple of str
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    def to_control(self) -> control.StateSpace:
        """As python-control has it, with the same names.

        Returns
        -------
        control.StateSpace
            Continuous; python-control has to be installed.
        """
        import control

        return control.StateSpace(self.A, self.B, self.C, self.D, states=list(self.states), inputs=list(self.inputs),
                                  outputs=list(self.outputs))

    def select(self, inputs: tuple[str, ...] | None = None, outputs: tuple[str, ...] | None = None) -> StateSpace:
        """The same with some of its inputs and outputs, in the order requested.

        Parameters
        ----------
        inputs, outputs : tuple of str, optional
            Names to keep; all where left out.

        Returns
        -------
        StateSpace
            With all of its states.
        """
        inputs, outputs = inputs or self.inputs, outputs or self.outputs
        columns = [self.inputs.index(checks.known_name(n, self.inputs, "input")) for n in inputs]
        rows = [self.outputs.index(checks.known_name(n, self.outputs, "output")) for n in outputs]
        return StateSpace(self.A, self.B[:, columns], self.C[rows], self.D[np.ix_(rows, columns)], self.states,
                          tuple(inputs), tuple(outputs))


@dataclass(frozen=True)
class LinearCar:
    """Two masses on springs and a viscous damper, z up, about the static equilibrium.

    ::

        m_s z̈_s   = −k_s (z_s − z_us) − c (ż_s − ż_us) − F
        m_us z̈_us =  k_s (z_s − z_us) + c (ż_s − ż_us) + F − k_t (z_us − z_r) − c_t (ż_us − ż_r)

    F is a further damper force, positive in extension (tension). Equation sheet, 4.1.

    Attributes
    ----------
    parameters : CarParameters

    Examples
    --------
    >>> from quartercar.parameters import MEGANE
    >>> car = LinearCar(MEGANE.replace(tyre_stiffness=208e3))
    >>> round(car.h2_norms()["body_acceleration"], 4)
    51.0168
    """

    parameters: CarParameters

    # -- state spaces ------------------------------------------------------------------------------------------------
    def relative(self) -> StateSpace:
        """States z_s − z_us, ż_s, z_us − z_r, ż_us; inputs road velocity ż_r and damper force F.

        Returns
        -------
        StateSpace
            Outputs as `RELATIVE`; SI.
        """
        ms, mu, k, c, kt, ct = self._numbers
        a = np.array([[0, 1, 0, -1], [-k / ms, -c / ms, 0, c / ms], [0, 0, 0, 1],
                      [k / mu, c / mu, -kt / mu, -(c + ct) / mu]])
        b = np.array([[0, 0], [0, -1 / ms], [-1, 0], [ct / mu, 1 / mu]])
        out = np.array([a[1], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, kt, ct], [0, 1, 0, -1], [0, 1, 0, 0], [0, 0, 0, 1]])
        through = np.zeros((7, 2))
        through[0], through[3, 0] = b[1], -ct
        return StateSpace(a, b, out, through, ("suspension_deflection", "body_velocity", "tyre_deflection",
                                               "wheel_velocity"), ("road_velocity", "damper_force"), RELATIVE)

    def absolute(self) -> StateSpace:
        """States z_s, ż_s, z_us, ż_us; inputs road z_r, its velocity (it counts with c_t only), damper force F.

        Returns
        -------
        StateSpace
            Outputs as `OUTPUTS`; SI.
        """
        ms, mu, k, c, kt, ct = self._numbers
        a = np.array([[0, 1, 0, 0], [-k / ms, -c / ms, k / ms, c / ms], [0, 0, 0, 1],
                      [k / mu, c / mu, -(k + kt) / mu, -(c + ct) / mu]])
        b = np.array([[0, 0, 0], [0, 0, -1 / ms], [0, 0, 0], [kt / mu, ct / mu, 1 / mu]])
        out = np.array([a[1], [1, 0, -1, 0], [0, 0, 1, 0], [0, 0, kt, ct], [0, 1, 0, -1], [0, 1, 0, 0], [0, 0, 0, 1],
                        [1, 0, 0, 0], [0, 0, 1, 0]])
        through = np.zeros((9, 3))
        through[0], through[2, 0], through[3, :2] = b[1], -1, (-kt, -ct)
        return StateSpace(a, b, out, through, ("body_displacement", "body_velocity", "wheel_displacement",
                                               "wheel_velocity"), ("road", "road_velocity", "damper_force"),
                          tuple(OUTPUTS))

    # -- responses ---------------------------------------------------------------------------------------------------
    def frequency_response(self, frequency: np.ndarray, output: str) -> np.ndarray:
        """(n,) complex response of an output of `OUTPUTS` to the road's elevation, per metre.

        Parameters
        ----------
        frequency : (n,) array
            [Hz].
        output : str

        Returns
        -------
        (n,) complex array
            In the unit of the output per metre of road.

        Examples
        --------
        >>> from quartercar.parameters import MEGANE
        >>> abs(LinearCar(MEGANE).frequency_response(np.array([10.0]), "body_acceleration")).round(2)
        array([518.6])
        """
        system = self.absolute().select(outputs=(checks.known_name(output, tuple(OUTPUTS), "output of a car"),))
        s = 2j * np.pi * np.atleast_1d(np.asarray(frequency, dtype=float))
        drive = system.B[:, 0][:, None] + s * system.B[:, 1][:, None]
        states = np.linalg.solve(s[:, None, None] * np.eye(4) - system.A, drive.T[:, :, None])[:, :, 0]
        return states @ system.C[0] + system.D[0, 0] + s * system.D[0, 1]

    def modes(self) -> list[tuple[float, float]]:
        """(frequency [Hz], damping ratio) of every oscillation, slowest first; an overdamped pole counts by itself.

        Returns
        -------
        list of (float, float)
            Undamped frequency |p|/2π [Hz], damping ratio −Re p/|p|.
        """
        poles = np.linalg.eigvals(self.relative().A)
        kept = sorted((p for p in poles if p.imag >= 0), key=abs)
        return [(float(abs(p) / (2 * np.pi)), float(-p.real / abs(p))) for p in kept]

    def invariants(self) -> dict[str, tuple[float, float]]:
        """(frequency [Hz], gain to road elevation) that no force between the masses can change; tyre without damping.

        Body acceleration: k_t/m_s at ω² = k_t/m_us. Suspension deflection: (m_s + m_us)/m_s at ω² = k_t/(m_s + m_us).

        Returns
        -------
        dict of str to (float, float)
            Of `body_acceleration` [1/s²] and `suspension_deflection` [1].

        Raises
        ------
        InputError
            A tyre with damping.
        """
        ms, mu, _, _, kt, ct = self._numbers
        if ct:
            raise InputError("the invariants belong to a tyre without damping", got=f"tyre_damping {ct:g} N*s/m")
        return {"body_acceleration": (float(np.sqrt(kt / mu)) / (2 * np.pi), kt / ms),
                "suspension_deflection": (float(np.sqrt(kt / (ms + mu))) / (2 * np.pi), (ms + mu) / ms)}

    # -- random roads ------------------------------------------------------------------------------------------------
    def h2_norms(self) -> dict[str, float]:
        """Rms of each relative output for a white road velocity of two-sided intensity 1, in closed form.

        With M = m_s + m_us: acceleration² = (M k²/c + c k_t)/(2 m_s²), deflection² = M/(2c), deflection rate² =
        k_t/(2c); the others from the stationary moments of 4.1, solved by hand. A tyre with damping passes white noise
        on: `lyapunov_norms` then gives the norms that exist.

        Returns
        -------
        dict of str to float
            By the names of `RELATIVE`, in the SI unit of each, for an intensity of 1 m²/s.

        Raises
        ------
        InputError
            A tyre with damping, a car without.
        """
        ms, mu, k, c, kt, ct = self._numbers
        if ct:
            raise InputError("the closed form is that of a tyre without damping", got=f"tyre_damping {ct:g} N*s/m",
                             mend="lyapunov_norms")
        if not c:
            raise InputError("a car without damping has no stationary response", got="damping 0 N*s/m")
        total = ms + mu
        cross = (k * total**2 / ms - mu * kt) / (2 * c * kt)
        both = (k * cross + c * total / (2 * ms)) / ms
        wheel = both - (k * total / ms - kt) / (2 * c)
        tyre = (mu * wheel + k * cross + c * total / (2 * ms)) / kt
        squares = {"body_acceleration": (total * k**2 / c + c * kt) / (2 * ms**2),
                   "suspension_deflection": total / (2 * c), "tyre_deflection": tyre, "tyre_force": kt**2 * tyre,
                   "suspension_velocity": kt / (2 * c), "body_velocity": both + k * total / (2 * c * ms),
                   "wheel_velocity": wheel}
        return {name: float(np.sqrt(squares[name])) for name in RELATIVE}

    def lyapunov_norms(self) -> dict[str, float]:
        """The same by A P + P Aᵀ + B Bᵀ = 0, for any car; infinite where white noise passes straight through.

        Returns
        -------
        dict of str to float
            As `h2_norms`.

        Raises
        ------
        NumericalError
            A car that is not asymptotically stable.
        """
        from scipy.linalg import solve_continuous_lyapunov

        system = self.relative().select(inputs=("road_velocity",))
        poles = np.linalg.eigvals(system.A)
        if poles.real.max() >= -1e-12 * np.abs(poles).max():
            raise NumericalError("this car has no stationary response: it is not asymptotically stable")
        p = solve_continuous_lyapunov(system.A, -system.B @ system.B.T)
        squares = np.einsum("ij,jk,ik->i", system.C, p, system.C)
        return {name: float(np.inf if d else np.sqrt(s))
                for name, s, d in zip(system.outputs, squares, system.D[:, 0], strict=True)}

    def road_rms(self, road_class: str, speed: float) -> dict[str, float]:
        """Rms of each relative output on an ISO 8608 road (waviness 2, no cut-off) at a constant speed [m/s].

        The road's velocity is white, of one-sided density 4π²n_0²G_d V, so that rms = H2·√(half of it).

        Parameters
        ----------
        road_class : str
            ``"A"`` … ``"H"``.
        speed : float
            [m/s].

        Returns
        -------
        dict of str to float
            By the names of `RELATIVE`, SI.
        """
        density = 4 * np.pi**2 * iso_roughness(road_class).coefficient * checks.positive(speed, "speed", "m/s")
        return {name: norm * float(np.sqrt(density / 2)) for name, norm in self.lyapunov_norms().items()}

    @property
    def _numbers(self) -> tuple[float, float, float, float, float, float]:
        p = self.parameters
        return p.sprung_mass, p.unsprung_mass, p.spring_stiffness, p.damping, p.tyre_stiffness, p.tyre_damping
