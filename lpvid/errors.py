"""The two ways to fall short: the caller's input is at fault, or the numbers are."""

from __future__ import annotations


class LpvError(Exception):
    """Base of every error that this package raises on purpose."""

    exit_code = 1


class InputError(LpvError, ValueError):
    """The input is at fault; one line states what, got, why and how to mend it (exit code 2).

    Parameters
    ----------
    what : str
        What is wrong, naming file, row, channel or argument.
    got : object, optional
        What was found instead.
    why : str, optional
        Why that cannot be used.
    mend : str, optional
        What the caller can do.

    Examples
    --------
    >>> print(InputError("no channel 'force'", got="time, velocity", mend="map it with --role force=NAME"))
    no channel 'force': got time, velocity. Mend: map it with --role force=NAME.
    """

    exit_code = 2

    def __init__(self, what: str, *, got: object = None, why: str | None = None, mend: str | None = None) -> None:
        self.what, self.got, self.why, self.mend = what, got, why, mend
        text = what
        if got is not None:
            text += f": got {got}"
        if why:
            text += f"; {why}"
        text = text.rstrip(".") + "."
        if mend:
            text += f" Mend: {mend}" if mend.endswith("?") else f" Mend: {mend.rstrip('.')}."
        super().__init__(" ".join(text.split()))


class TooFewSamples(InputError):
    """The records are too short for what is to be estimated from them (exit code 2); parameters as for `InputError`."""


class ExtrapolationWarning(UserWarning):
    """A model or a controller is evaluated outside the range that it was fitted on, or designed for."""


class NumericalError(LpvError, ArithmeticError):
    """A numerical outcome short of what the caller requested (exit code 3)."""

    exit_code = 3
