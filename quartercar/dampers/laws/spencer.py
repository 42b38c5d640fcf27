"""The modified Bouc-Wen model in its printed form, and a published set."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SpencerParameters:
    """The model as it is printed, in SI: fourteen numbers, of which the data can determine thirteen.

    F = c_1 ẏ + k_1(x − x_0), ẏ = [α z + c_0 ẋ + k_0(x − y)]/(c_0 + c_1), r = ẋ − ẏ,
    ż = −γ|r| z|z|^{n−1} − β r|z|^n + A r, with α, c_0, c_1 affine in w and ẇ = −η(w − V).

    Attributes
    ----------
    c_0a, c_1a : float
        [N·s/m].
    alpha_a : float
        [N/m].
    c_0b, c_1b, alpha_b : float
        The same per unit of current or voltage.
    k_0, k_1, x_0 : float
        [N/m], [N/m], [m].
    beta, gamma : float
        [m⁻ⁿ].
    A, n : float
    eta : float
        [1/s]; 0 where the current acts at once.
    """

    c_0a: float
    c_1a: float
    alpha_a: float
    k_0: float
    k_1: float
    x_0: float
    beta: float
    gamma: float
    A: float
    n: float = 2.0
    c_0b: float = 0.0
    c_1b: float = 0.0
    alpha_b: float = 0.0
    eta: float = 0.0

    @property
    def scheduled(self) -> bool:
        """Whether anything depends on the current."""
        return any((self.c_0b, self.c_1b, self.alpha_b))


LORD = SpencerParameters(c_0a=2100.0, c_0b=350.0, k_0=4690.0, c_1a=28300.0, c_1b=295.0, k_1=500.0, x_0=0.143,
                         alpha_a=14000.0, alpha_b=69500.0, gamma=363e4, beta=363e4, A=301.0, n=2.0, eta=190.0)
"""Prototype MR damper of Lord at 0 to 2.25 V: Dyke, Spencer, Sain, Carlson (1996), Smart Mater. Struct. 5, 565-575."""
