"""Other states of a system, x = Tξ, with what the change adds to the rounding errors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lpvid.lmi.certificate import EPS
from lpvid.lmi.driven import Driven
from lpvid.lmi.long_products import long_product


@dataclass(frozen=True, eq=False)
class Coordinates:
    """x = Tξ, with L computed for T⁻¹ and a bound W of what that multiplies magnitudes by.

    From LT = I − E follows T⁻¹ = (I − E)⁻¹L: but for terms in E², which are below a unit of rounding where ‖E‖² is,
    |T⁻¹ − L| ≤ |E||L| (Higham 2002, 14.1). E as computed is off by n units of |L||T|, and the products LAT by 2n units
    of |L||A||T|. With W = I + |L||T| + |E|/nε all are less than 6nε W|L||A||T|.

    Attributes
    ----------
    into : (n, n) array
        T.
    back : (n, n) array
        L.
    growth : (n, n) array
        W.
    """

    into: np.ndarray
    back: np.ndarray
    growth: np.ndarray

    @classmethod
    def of(cls, states: np.ndarray | None, n: int) -> Coordinates | None:
        """The change of states.

        Parameters
        ----------
        states : (n, n) array or None
            T; None for the identity.
        n : int
            Order.

        Returns
        -------
        Coordinates or None
            None where E is more than rounding.
        """
        eye = np.eye(n)
        if states is None:
            return cls(eye, eye, eye)
        try:
            back = _inverse(states)
        except np.linalg.LinAlgError:
            return None
        off = np.abs(eye - back @ states)
        if not np.linalg.norm(off) ** 2 <= EPS:
            return None
        return cls(states, back, eye + np.abs(back) @ np.abs(states) + off / (n * EPS))

    def magnitudes(self, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of T⁻¹AT, T⁻¹B, CT.

        Parameters
        ----------
        a, b, c : (…, n, n), (…, n, n_w) and (…, n_z, n) arrays

        Returns
        -------
        tuple of arrays
            What the rounding errors of the three products are shares of.
        """
        into, back = np.abs(self.into), self.growth @ np.abs(self.back)
        return back @ np.abs(a) @ into, back @ np.abs(b), np.abs(c) @ into


def _inverse(states: np.ndarray) -> np.ndarray:
    """T⁻¹ by way of rows of like size: those of T are as different as the units of the states.

    Powers of two round nothing. With T of the missile autopilot, whose rows lie twelve decades apart, I − LT falls from
    6e-2 to 2e-9.
    """
    size = np.abs(states).max(axis=1)
    with np.errstate(divide="ignore"):
        scale = np.where(size > 0, np.exp2(-np.round(np.log2(size))), 1.0)
    return np.linalg.inv(scale[:, None] * states) * scale


def over_states(system: Driven, states: np.ndarray | None) -> Driven | None:
    """A system over the states ξ of x = Tξ, its rounding errors included in `Driven.magnitudes`.

    Parameters
    ----------
    system : Driven
    states : (n, n) array or None
        T; None leaves the system as it is.

    Returns
    -------
    Driven or None
        None where T is singular, or nearly.
    """
    if states is None:
        return system
    n, of = system.order, system.coefficients
    change = Change.of(states)
    if change is None:
        return None
    made, off = np.empty_like(of), np.zeros_like(of)
    made[:, n:, n:] = of[:, n:, n:]
    out, into = slice(n, None), slice(n)
    made[:, into, into], off[:, into, into] = change.behind(*change.before(of[:, into, into]))
    made[:, into, out], off[:, into, out] = change.behind((of[:, into, out], np.zeros_like(of[:, into, out])),
                                                          np.abs(of[:, into, out]))
    made[:, out, into], off[:, out, into] = change.shown(of[:, out, into])
    return replace(system, coefficients=made, sizes=np.abs(made) + off / (6 * max(n, 1) * EPS))


@dataclass(frozen=True, eq=False)
class Change:
    """x = Tξ in products of twice the digits: T⁻¹AT is off by its own last digit, not by that of |T⁻¹||A||T|.

    With L computed for T⁻¹ and E = I − LT, from `long_product`, T⁻¹ = (I + E + E²(I − E)⁻¹)L: the product LAT and E
    times it are computed, the rest is bounded.

    Attributes
    ----------
    states : (n, n) array
        T.
    back : (n, n) array
        L.
    off : (n, n) array
        E.
    """

    states: np.ndarray
    back: np.ndarray
    off: np.ndarray

    @classmethod
    def of(cls, states: np.ndarray) -> Change | None:
        """The change of states.

        Parameters
        ----------
        states : (n, n) array
            T.

        Returns
        -------
        Change or None
            None where T is singular, or L so far from its inverse that E² is more than rounding.
        """
        try:
            back = _inverse(states)
        except np.linalg.LinAlgError:
            return None
        high, low = long_product(back, states)
        off = (np.eye(len(states)) - high) - low
        return cls(states, back, off) if np.linalg.norm(off) ** 2 <= EPS else None

    def before(self, a: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
        """AT in two parts.

        Parameters
        ----------
        a : (K, m, n) array

        Returns
        -------
        ((K, m, n) array, (K, m, n) array)
            The product and what it is off by.
        (K, m, n) array
            |A||T|.
        """
        return long_product(a, self.states), np.abs(a) @ np.abs(self.states)

    def shown(self, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """CT.

        Parameters
        ----------
        c : (K, m, n) array

        Returns
        -------
        ((K, m, n) array, (K, m, n) array)
            The product, and a bound of its error.
        """
        (high, low), size = self.before(c)
        return high + low, EPS * np.abs(high + low) + (len(self.states) * EPS) ** 2 * size

    def behind(self, parts: tuple[np.ndarray, np.ndarray], size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """T⁻¹M for M = `high` + `low`.

        Parameters
        ----------
        parts : ((K, n, m) array, (K, n, m) array)
            M.
        size : (K, n, m) array
            Magnitudes that M came from, of whose (nε)² it is off.

        Returns
        -------
        ((K, n, m) array, (K, n, m) array)
            The product, and a bound of its error: of L(high + low) ε and 4(nε)²|L| `size`, of the product with E
            (n + 2)ε|E| times it, and 2|E|² times it for what is left out.
        """
        n, e = len(self.states), np.abs(self.off)
        high, low = long_product(self.back, parts[0])
        first = high + (low + self.back @ parts[1])
        made, large = first + self.off @ first, np.abs(first)
        return made, (2 * EPS * np.maximum(large, np.abs(made)) + 4 * (n * EPS) ** 2 * (np.abs(self.back) @ size)
                      + (n + 2) * EPS * (e @ large) + 2 * (e @ (e @ large)))
