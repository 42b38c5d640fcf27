"""Fourier: cosines and sines of one scheduling variable, an angle for instance."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.scheduling.basis import Basis
from lpvid.scheduling.reading import Reading
from lpvid.scheduling.variables import Scheduling


@dataclass(frozen=True)
class Fourier(Basis):
    """1, cos kωz, sin kωz for k = 1 … harmonics, with ω = 2π/period and z = p − origin.

    It is no polynomial in p: between the points of a grid Bernstein coefficients alone decide nothing
    (`certify_stability` refuses it, `l2_gain` and `decay_rate` interpolate). `overshoot` states what samples of a full
    period promise.

    Parameters
    ----------
    name : str
        Scheduling variable.
    harmonics : int
        Highest k.
    period : float
        In the variable's unit; 2π for an angle in radians.
    origin : float
        Where the cosines have their maximum.

    Examples
    --------
    >>> Fourier("angle", 2).labels
    ('1', 'cos(angle)', 'sin(angle)', 'cos(2*angle)', 'sin(2*angle)')
    >>> Fourier("angle", 1).evaluate(np.array([[np.pi / 2]])).round(12)
    array([[1., 0., 1.]])
    """

    kind = "fourier"

    name: str
    harmonics: int = 1
    period: float = 2 * math.pi
    origin: float = 0.0
    degree: ClassVar[None] = None
    lags: ClassVar[tuple[int, int]] = (0, 0)

    def __post_init__(self) -> None:
        if len(_checks.names(self.name, "a Fourier basis")) > 1:
            raise InputError("a Fourier basis has one variable", got=self.name, mend="multiply two of them")
        object.__setattr__(self, "harmonics", _checks.count(self.harmonics, "harmonics of a Fourier basis", at_least=1))
        object.__setattr__(self, "period", _checks.positive(self.period, "the period of a Fourier basis"))
        object.__setattr__(self, "origin", _checks.real(self.origin, "the origin of a Fourier basis"))

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        """The one scheduling variable."""
        return (self.name,)

    @property
    def size(self) -> int:
        return 2 * self.harmonics + 1

    @property
    def labels(self) -> tuple[str, ...]:
        plain = math.isclose(self.period, 2 * math.pi) and not self.origin
        inner = self.name if plain else f"2pi*({self.name}-{self.origin:g})/{self.period:g}"
        terms = [(f"{k}*" if k > 1 else "") + inner for k in range(1, self.harmonics + 1)]
        return ("1", *(f"{f}({t})" for t in terms for f in ("cos", "sin")))

    def _angles(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        k = np.arange(1, self.harmonics + 1) * (2 * math.pi / self.period)
        return k, (np.asarray(p, dtype=float)[:, :1] - self.origin) * k

    def _interleaved(self, first: float, odd: np.ndarray, even: np.ndarray) -> np.ndarray:
        out = np.full((len(odd), self.size), first)
        out[:, 1::2], out[:, 2::2] = odd, even
        return out

    def evaluate(self, p: np.ndarray) -> np.ndarray:
        _, angle = self._angles(p)
        return self._interleaved(1.0, np.cos(angle), np.sin(angle))

    def derivative(self, p: np.ndarray, name: str) -> np.ndarray:
        _checks.known_name(name, self.names, "scheduling variable")
        k, angle = self._angles(p)
        return self._interleaved(0.0, -k * np.sin(angle), k * np.cos(angle))

    def bound(self, box: Scheduling) -> Fourier:
        _checks.known_name(self.name, box.names, "scheduling variable")
        return self

    @property
    def unity(self) -> np.ndarray:
        return np.eye(1, self.size)[0]

    def overshoot(self, samples: int) -> float:
        """1/cos(πd/N): how far a sum of these functions can exceed its samples.

        For T = Σ c_k φ_k of degree d = `harmonics` and N > 2d equidistant points over one full period,
        max |T| ≤ max_samples |T| / cos(πd/N) (M. Riesz: next to a maximum M, |T| ≥ M cos dθ). The same holds for the
        spectral norm of a matrix of such sums, and, for its eigenvalues between m and M on the samples, at every point
        λ_max ≤ (M + m)/2 + (M − m)/2 / cos(πd/N). An expression of products has the summed degree.

        Parameters
        ----------
        samples : int
            N, equidistant over one full period.

        Returns
        -------
        float
            At least 1.

        Raises
        ------
        InputError
            N ≤ 2d: the samples give no information.

        Examples
        --------
        >>> round(Fourier("angle", 1).overshoot(12), 4)
        1.0353
        """
        if _checks.count(samples, "samples over the period") <= 2 * self.harmonics:
            raise InputError("too few samples to bound a Fourier sum", got=samples,
                             mend=f"take more than {2 * self.harmonics} over the period")
        return 1.0 / math.cos(math.pi * self.harmonics / samples)

    def readings(self, shift: int = 0) -> tuple[Reading, ...]:
        return (Reading(self.name, shift, 0, (), 2 * math.pi * self.harmonics / self.period),)

    def ranges(self, limits: Mapping[str, tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
        low = -np.ones(self.size)
        low[0] = 1.0
        return low, np.ones(self.size)

    def trimmed(self, c: np.ndarray) -> tuple[Basis, np.ndarray]:
        used = np.flatnonzero(c.reshape(self.size, -1).any(axis=1)).max(initial=1)
        return replace(self, harmonics=int(used + 1) // 2), c[: 2 * (int(used + 1) // 2) + 1]
