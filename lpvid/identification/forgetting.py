"""How a recursive estimate forgets, and when it opens its covariance again."""

from __future__ import annotations

from dataclasses import dataclass

from lpvid import _checks
from lpvid.codec import Encoded
from lpvid.errors import InputError


@dataclass(frozen=True)
class VariableForgetting(Encoded):
    """Forget fast where the prediction error is large: λ = 1 − ε²/(memory σ² (1 + φᵀPφ)), not below `lowest`.

    Fortescue, Kershenbaum & Ydstie 1981. The noise variance σ² is learnt from the start and from a slow average of the
    errors.

    Parameters
    ----------
    memory : float
        Samples remembered when the error is what the noise makes it.
    lowest : float
        Least λ.

    Examples
    --------
    >>> VariableForgetting(memory=200).to_dict()
    {'kind': 'variable', 'memory': 200.0, 'lowest': 0.9}
    """

    kind = "variable"
    JSON = ("kind", ...)

    memory: float = 1000.0
    lowest: float = 0.9

    def __post_init__(self) -> None:
        memory = _checks.positive(self.memory, "the memory of variable forgetting", "samples")
        object.__setattr__(self, "memory", memory)
        object.__setattr__(self, "lowest", forgetting_factor(self.lowest, "the lowest forgetting factor"))


@dataclass(frozen=True)
class CovarianceReset(Encoded):
    """Set P back to ``to · diag(1/mean square of each regressor)`` when its mean variance leaves its bounds.

    Variances are in unit-column scaling: 1 is the information of one sample of typical size on a lone parameter. Grown
    `above` times its least value: old knowledge has been forgotten without new excitation (wind-up), and the next
    sample would throw the parameters about. Fallen below `below`: the recursion is asleep.

    Parameters
    ----------
    above : float
        Growth of the mean variance over its least since the last reset; infinity never acts.
    below : float
        Mean variance; 0 never acts.
    to : float
        Variance after a reset.
    """

    above: float = 1e4
    below: float = 0.0
    to: float = 1.0

    def __post_init__(self) -> None:
        _checks.positive(self.to, "the variance after a reset")
        if not (0 <= self.below <= self.to and self.above > 1):
            raise InputError("a covariance reset needs 0 <= below <= to, and above > 1",
                             got=f"below {self.below}, to {self.to}, above {self.above}")


def forgetting_factor(value: object, name: str) -> float:
    """A forgetting factor, above 0 and up to 1.

    Parameters
    ----------
    value : object
        What the caller gave.
    name : str
        What it is, for the error message.

    Returns
    -------
    float

    Raises
    ------
    InputError
        Not above 0, or above 1.
    """
    number = _checks.real(value, name)
    if not 0 < number <= 1:
        raise InputError(f"{name} must lie above 0 and not above 1", got=value)
    return number
