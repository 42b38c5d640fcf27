"""Structures of controllers: fixed dynamics around one gain matrix G(p), of which only chosen entries are free.

::

      y ──>┌───────────┐──> u            v = G(p) ξ      v: demands, ξ: readings
           │ interface │
      v ──>│  (fixed)  │──> ξ            static gain:  ξ = y, u = v
       └── │           │ ──┐            PID:          ξ = (y, ∫y, filtered dy/dt), u = v
           └───────────┘   │            order k:      ξ = (x_K, y), v = (ẋ_K, u)
              G(p) <───────┘            observer:     ξ = (y − ŷ, x̂), v = (L (y − ŷ), K x̂)

Every controller of fixed structure is a static output feedback of the plant joined to its interface (Apkarian & Noll,
IEEE TAC 51 (2006) 71-86, section II).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.interconnection import connect
from lpvid.synthesis.matrix_function import block
from lpvid.synthesis.plant_functions import assembled, named, plant_functions

DEMAND, READING = " demand", "reading of "
TERMS = ("proportional", "integral", "derivative")
GAINS = "gain surfaces"
"""Key of a controller's metadata under which its gains are kept."""


@dataclass(frozen=True, eq=False)
class Attached:
    """A structure in place: what a gain matrix from readings to demands has to control.

    Parameters
    ----------
    plant : GeneralizedPlant
        The plant with the interface; its controls are the demands, its measurements the readings.
    interface : LPVStateSpace
    free : (demands, readings) bool array
        Which entries of the gain may differ from zero.
    controls, measurements : tuple of str
        Of the plant itself.
    """

    plant: GeneralizedPlant
    interface: LPVStateSpace
    free: np.ndarray
    controls: tuple[str, ...]
    measurements: tuple[str, ...]

    def controller(self, basis: Basis, gains: np.ndarray) -> LPVStateSpace:
        """The controller with G(p) = Σ gains[k] ψ_k(p); the surfaces are kept in its metadata.

        Parameters
        ----------
        basis : Basis
            ψ_k(p) of the gains.
        gains : (K, n_v, n_ξ) array
            One matrix from readings to demands for each basis function.

        Returns
        -------
        LPVStateSpace
            From measurements to controls.
        """
        box = self.plant.box.part(basis.names)
        demands, readings = named(self.plant, self.plant.controls), named(self.plant, self.plant.measurements)
        law = LPVStateSpace.of(gains, 0, basis, self.plant.sample_time, box, inputs=readings, outputs=demands)
        whole = connect([self.interface, law], self.measurements, self.controls)
        kept = {"rows": [d.name.removesuffix(DEMAND) for d in demands],
                "columns": [r.name.removeprefix(READING) for r in readings],
                "free": self.free.tolist(), "basis": basis.to_dict(), "gains": np.asarray(gains).tolist(),
                "box": box.to_dict()}
        return whole.replace(metadata={**whole.metadata, GAINS: kept})


class Structure(ABC):
    """What a designer may change of a controller, and what stays."""

    @abstractmethod
    def attach(self, plant: GeneralizedPlant) -> Attached:
        """The plant with the interface of this structure.

        Parameters
        ----------
        plant : GeneralizedPlant
            The plant that the controller is for.

        Returns
        -------
        Attached
            Plant with interface, and which entries of the gain are free.
        """


@dataclass(frozen=True)
class StaticGain(Structure):
    """u = G(p) y.

    Parameters
    ----------
    paths : mapping of control to measurements, optional
        Which measurements a control may use; one that is left out uses all.

    Examples
    --------
    >>> StaticGain({"force": ["speed"]}).paths
    {'force': ('speed',)}
    """

    paths: Mapping[str, Sequence[str]] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "paths", _tidy(self.paths))

    def attach(self, plant: GeneralizedPlant) -> Attached:
        """The plant itself, with its measurements as readings."""
        nu, ny = len(plant.controls), len(plant.measurements)
        return _attached(plant, _gainful(plant, np.eye(ny), plant.measurements), _paths(plant, self.paths), nu)


@dataclass(frozen=True)
class PID(Structure):
    """u = (K_p + K_i/s + K_d s/(τs + 1)) y with gains over the scheduling; in discrete time the sum T/(z − 1) and
    (z − 1)/((τ + T)z − τ).

    Parameters
    ----------
    filter : float, optional
        τ [s] of the derivative. Left out, there is no derivative.
    integral : bool
        With K_i.
    proportional : bool
        With K_p.
    paths : mapping of control to measurements, optional
        As for `StaticGain`.

    Examples
    --------
    >>> PID(filter=0.01).terms
    ('proportional', 'integral', 'derivative')
    """

    filter: float | None = None
    integral: bool = True
    proportional: bool = True
    paths: Mapping[str, Sequence[str]] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "paths", _tidy(self.paths))
        if self.filter is not None:
            object.__setattr__(self, "filter", _checks.positive(self.filter, "the filter of a derivative", "s"))
        if not self.terms:
            raise InputError("a PID needs a term", got="neither proportional, integral nor derivative")

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of the terms in use."""
        used = (self.proportional, self.integral, self.filter is not None)
        return tuple(n for n, u in zip(TERMS, used, strict=True) if u)

    def attach(self, plant: GeneralizedPlant) -> Attached:
        """The plant with an integrator and a filtered derivative behind every measurement."""
        ny, nu, t = len(plant.measurements), len(plant.controls), plant.sample_time
        eye, zero = np.eye(ny), np.zeros((ny, ny))
        blocks: dict[str, tuple[np.ndarray, ...]] = {"proportional": (np.zeros((0, 0)), np.zeros((0, ny)),
                                                                      np.zeros((ny, 0)), eye)}
        blocks["integral"] = (zero, eye, eye, zero) if t is None else (eye, t * eye, eye, zero)
        if self.filter is not None and t is None:
            blocks["derivative"] = (-eye / self.filter, eye / self.filter, -eye / self.filter, eye / self.filter)
        elif self.filter is not None and t is not None:
            wide = self.filter + t  # x⁺ = (τ x + y)/(τ + T), ξ = (y − T x)/(τ + T): no gain at rest
            blocks["derivative"] = (self.filter / wide * eye, eye / wide, -t / wide * eye, eye / wide)
        chosen = [blocks[n] for n in self.terms]
        orders = np.cumsum([0, *(len(a) for a, _, _, _ in chosen)])
        a, c = np.zeros((orders[-1],) * 2), np.zeros((ny * len(chosen), orders[-1]))
        for k, (x, _, y, _) in enumerate(chosen):
            part = slice(orders[k], orders[k + 1])
            a[part, part], c[k * ny : (k + 1) * ny, part] = x, y
        b, d = np.vstack([x for _, x, _, _ in chosen]), np.vstack([x for _, _, _, x in chosen])
        names = [f"{n} {y}" for n in self.terms for y in plant.measurements]
        own = np.tile(_paths(plant, self.paths), (1, len(chosen)))
        return _attached(plant, _gainful(plant, d, names, a, b, c), own, nu)


@dataclass(frozen=True)
class LowOrder(Structure):
    """ẋ_K (or x_K⁺) = A_K(p) x_K + B_K(p) y, u = C_K(p) x_K + D_K(p) y with few states.

    Parameters
    ----------
    order : int
        Number of states x_K.
    strictly_proper : bool
        D_K = 0.
    paths : mapping of control to measurements, optional
        Which entries of D_K are free.

    Examples
    --------
    >>> LowOrder(2).order
    2
    """

    order: int
    strictly_proper: bool = False
    paths: Mapping[str, Sequence[str]] | None = None

    def __post_init__(self) -> None:
        _checks.count(self.order, "the order of a controller", at_least=1)
        object.__setattr__(self, "paths", _tidy(self.paths))

    def attach(self, plant: GeneralizedPlant) -> Attached:
        """The plant with `order` integrators (delays) that the demands drive."""
        k, ny, nu = self.order, len(plant.measurements), len(plant.controls)
        states = [f"controller state {i + 1}" for i in range(k)]
        free = np.ones((nu + k, k + ny), dtype=bool)
        free[:nu, k:] = False if self.strictly_proper else _paths(plant, self.paths)
        interface = _system(plant, np.zeros((k, k)), np.hstack([np.zeros((k, ny + nu)), np.eye(k)]),
                            np.vstack([np.zeros((nu, k)), np.eye(k), np.zeros((ny, k))]),
                            np.block([[np.zeros((nu, ny)), np.eye(nu), np.zeros((nu, k))],
                                      [np.zeros((k, ny + nu + k))], [np.eye(ny), np.zeros((ny, nu + k))]]),
                            [*plant.measurements, *_demands(plant.controls), *_demands(states)],
                            [*plant.controls, *states, *(READING + n for n in plant.measurements)])
        return _attached(plant, interface, free, nu)


@dataclass(frozen=True)
class ObserverBased(Structure):
    """x̂⁺ = A(p) x̂ + B2(p) u + L(p)(y − C2(p) x̂), u = K(p) x̂: the plant's own model with an observer and a state gain.

    Examples
    --------
    >>> ObserverBased()
    ObserverBased()
    """

    def attach(self, plant: GeneralizedPlant) -> Attached:
        """The plant with a copy of its model.

        Parameters
        ----------
        plant : GeneralizedPlant
            Strictly proper from controls to measurements.

        Returns
        -------
        Attached
            Its free gains are those of state feedback and observer.

        Raises
        ------
        InputError
            A measurement that a control reaches directly.
        """
        p, n, ny, nu = plant_functions(plant), plant.order, len(plant.measurements), len(plant.controls)
        if p["D22"].coefficients.any():
            raise InputError("an observer-based controller needs measurements that controls do not reach directly",
                             got=", ".join(plant.measurements), mend="put a lag into that path")
        estimates = [f"estimate {i + 1}" for i in range(n)]
        whole = block([[p["A"], np.zeros((n, ny)), p["B2"], np.eye(n)],
                       [np.zeros((nu, n + ny)), np.eye(nu), np.zeros((nu, n))],
                       [-p["C2"], np.eye(ny), np.zeros((ny, nu + n))], [np.eye(n), np.zeros((n, ny + nu + n))]])
        free = np.zeros((nu + n, ny + n), dtype=bool)
        free[:nu, ny:] = free[nu:, :ny] = True
        signals = {s.name: s for s in (*plant.system.inputs, *plant.system.outputs)}
        inputs = [signals[y] for y in plant.measurements] + [
            Signal(x) for x in _demands([*plant.controls, *estimates])]
        outputs = [signals[u] for u in plant.controls] + [
            Signal(x) for x in (*(f"innovation of {y}" for y in plant.measurements), *estimates)]
        return _attached(plant, assembled(whole, n, plant, inputs, outputs), free, nu)


def _attached(plant: GeneralizedPlant, interface: LPVStateSpace, free: np.ndarray, nu: int) -> Attached:
    demands = [s.name for s in interface.inputs[len(plant.measurements):]]
    readings = [s.name for s in interface.outputs[nu:]]
    clash = sorted({*demands, *readings} & {s.name for s in (*plant.system.inputs, *plant.system.outputs)})
    if clash:
        raise InputError("a signal of the plant bears a name that the structure needs", got=", ".join(clash),
                         mend="rename it")
    whole = connect([plant.system, interface], [*plant.disturbances, *demands], [*plant.performance, *readings])
    if set(whole.box.names) != set(plant.box.names):  # a variable that nothing reads any more
        raise InputError("a scheduling variable drops out of the plant", got=", ".join(plant.box.names))
    joined = GeneralizedPlant(whole, tuple(demands), tuple(readings))
    if not free.any():
        raise InputError("a structure without a free gain", got="no path from a measurement to a control")
    return Attached(joined, interface, free, plant.controls, plant.measurements)


def _gainful(plant: GeneralizedPlant, d: np.ndarray, readings: Sequence[str], a: np.ndarray | None = None,
             b: np.ndarray | None = None, c: np.ndarray | None = None) -> LPVStateSpace:
    """u = v, ξ = c x + d y with ẋ = a x + b y."""
    ny, nu = len(plant.measurements), len(plant.controls)
    n = 0 if a is None else len(a)
    a, b, c = (np.zeros(s) if m is None else m for m, s in
               ((a, (n, n)), (b, (n, ny)), (c, (len(d), n))))
    names = [r if r not in plant.measurements else READING + r for r in readings]
    return _system(plant, a, np.hstack([b, np.zeros((n, nu))]), np.vstack([np.zeros((nu, n)), c]),
                   np.block([[np.zeros((nu, ny)), np.eye(nu)], [d, np.zeros((len(d), nu))]]),
                   [*plant.measurements, *_demands(plant.controls)], [*plant.controls, *names])


def _system(plant: GeneralizedPlant, a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray,
            inputs: Sequence[str], outputs: Sequence[str]) -> LPVStateSpace:
    units = {s.name: s.unit for s in (*plant.system.inputs, *plant.system.outputs)}
    return LPVStateSpace.still(a, b, c, d, plant.sample_time, inputs=tuple(Signal(n, units.get(n, "")) for n in inputs),
                               outputs=tuple(Signal(n, units.get(n, "")) for n in outputs))


def _demands(names: Sequence[str]) -> list[str]:
    return [n + DEMAND for n in names]


def _tidy(paths: Mapping[str, Sequence[str]] | None) -> dict[str, tuple[str, ...]] | None:
    return None if paths is None else {k: (v,) if isinstance(v, str) else tuple(v) for k, v in paths.items()}


def _paths(plant: GeneralizedPlant, paths: Mapping[str, Sequence[str]] | None) -> np.ndarray:
    """(n_u, n_y) bool."""
    free = np.ones((len(plant.controls), len(plant.measurements)), dtype=bool)
    for control, allowed in (paths or {}).items():
        row = plant.controls.index(_checks.known_name(control, plant.controls, "control"))
        chosen = [plant.measurements.index(_checks.known_name(n, plant.measurements, "measurement")) for n in allowed]
        free[row] = np.isin(np.arange(free.shape[1]), chosen)
    return free

