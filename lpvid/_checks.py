"""Every check of a caller's argument, in one place; kernels trust what passed here."""

from __future__ import annotations

import difflib
import shlex
from collections.abc import Iterable, Sequence
from typing import TypeGuard

import numpy as np

from lpvid.errors import InputError


def frozen_array(values: object, name: str, *, ndim: int | None = None, dtype: type = float) -> np.ndarray:
    """Copy `values` into a read-only C-ordered array of `dtype`; `ndim` is checked when given.

    What is such an array already, and cannot be written through another one, is not copied.
    """
    try:
        values = real_numbers(values)
        if getattr(getattr(values, "dtype", None), "kind", "") in ("M", "m"):
            raise TypeError("dates and durations are no numbers")
        array = values if _is_frozen(values, dtype) else np.array(values, dtype=dtype, order="C")
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must hold numbers", got=type(values).__name__, why=str(error)) from None
    if ndim is not None and array.ndim != ndim:
        raise InputError(f"{name} must have {ndim} dimension(s)", got=f"shape {array.shape}")
    array.setflags(write=False)
    return array


def real_numbers(values: object) -> object:
    """What may become real numbers: masked entries of numpy's are missing ones, NaN (of dates NaT).

    Raises
    ------
    TypeError
        Complex numbers, whose imaginary part would be lost.
    """
    if np.iscomplexobj(values):  # type: ignore[arg-type]
        raise TypeError("complex numbers have no place here")
    if not isinstance(values, np.ma.MaskedArray):
        return values
    if not np.ma.is_masked(values):
        return values.data
    known = values.data.copy() if values.dtype.kind in "mM" else values.data.astype(float)
    known[np.ma.getmaskarray(values)] = "NaT" if values.dtype.kind in "mM" else np.nan
    return known


def _is_frozen(values: object, dtype: type) -> TypeGuard[np.ndarray]:
    """Whether nobody can write to an array. One that is a part of another is not taken: it would keep all of that."""
    if type(values) is not np.ndarray or values.dtype != dtype or values.flags.writeable or \
            not values.flags.c_contiguous:
        return False
    base = values.base
    return base is None or (type(base) is np.ndarray and base.nbytes == values.nbytes and _is_frozen(base, dtype))


def owned(array: np.ndarray) -> np.ndarray:
    """The same array, read-only from now on: one that was just made, and of which nobody has another view.

    Parameters
    ----------
    array : ndarray

    Returns
    -------
    ndarray
        Which `frozen_array` takes without a copy.
    """
    array.setflags(write=False)
    return array


def read_only(array: np.ndarray) -> np.ndarray:
    """A view that cannot be written through: a kernel is compiled anew for a writable array where it had a frozen one.

    Parameters
    ----------
    array : ndarray
        What a kernel reads and does not write.

    Returns
    -------
    ndarray
        The same memory.
    """
    if not array.flags.writeable:
        return array
    view = array.view()
    view.flags.writeable = False
    return view


def finite(array: np.ndarray, name: str) -> np.ndarray:
    """Refuse NaN and infinite entries."""
    good = np.isfinite(array)
    if not good.all():
        place = tuple(int(i) for i in np.argwhere(~good)[0])
        raise InputError(f"{name} must be finite", got=f"{array[place]} at index {place}")
    return array


def shaped(array: np.ndarray, shape: Sequence[int | None], name: str) -> np.ndarray:
    """Require `shape`; None stands for any length."""
    if array.ndim != len(shape) or any(s is not None and s != a for s, a in zip(shape, array.shape, strict=True)):
        wanted = "(" + ", ".join("any" if s is None else str(s) for s in shape) + ")"
        raise InputError(f"{name} must have shape {wanted}", got=f"shape {array.shape}")
    return array


def positive(value: float, name: str, unit: str = "") -> float:
    """A finite number above zero."""
    number = real(value, name)
    if not number > 0:
        raise InputError(f"{name} must be positive", got=f"{value} {unit}".strip())
    return number


def real(value: object, name: str) -> float:
    """A finite real number."""
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise InputError(f"{name} must be a number", got=repr(value)) from None
    if not np.isfinite(number):
        raise InputError(f"{name} must be finite", got=value)
    return number


def count(value: object, name: str, *, at_least: int = 0) -> int:
    """A whole number not below `at_least`."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < at_least:
        raise InputError(f"{name} must be a whole number of at least {at_least}", got=repr(value))
    return int(value)


def generator(rng: object, name: str = "rng") -> np.random.Generator:
    """A source of random numbers as `numpy.random.default_rng` makes one of a seed; a generator is taken as it is.

    Nothing is drawn from the machine's own entropy: what is random here can be repeated.
    """
    try:
        if rng is None or isinstance(rng, (bool, float, str)):
            raise TypeError
        return np.random.default_rng(rng)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise InputError(f"{name} must be a seed, a whole number of at least 0, or a numpy.random.Generator",
                         got=repr(rng), mend=f"{name}=0 or {name}=numpy.random.default_rng(0)") from None


def counts(value: object, length: int, name: str, *, at_least: int = 0) -> tuple[int, ...]:
    """One whole number for each of `length` channels; a single number stands for all."""
    if isinstance(value, Iterable) and not isinstance(value, str):
        listed = tuple(count(v, name, at_least=at_least) for v in value)
        if len(listed) != length:
            raise InputError(f"{name} needs one number for each of {length} channel(s)", got=f"{len(listed)} numbers")
        return listed
    return (count(value, name, at_least=at_least),) * length


def one_of(value: str, allowed: Sequence[str], name: str) -> str:
    """A word from a list."""
    if value not in allowed:
        raise InputError(f"{name} must be one of {', '.join(allowed)}", got=repr(value), mend=_near(value, allowed))
    return value


def instance(value: object, kind: type | tuple[type, ...], what: str, mend: str = "") -> None:
    """Refuse an argument of another class; `what` is a whole phrase, such as "a car is driven over a RideRoad"."""
    if not isinstance(value, kind):
        raise InputError(what, got=f"the class {value.__name__}" if isinstance(value, type) else type(value).__name__,
                         mend=f"{value.__name__}(...)" if isinstance(value, type) and issubclass(value, kind) else mend)


def names(value: str | Sequence[str], name: str) -> tuple[str, ...]:
    """A name, several names, or a comma-separated list; at least one, all different."""
    parts = value.split(",") if isinstance(value, str) else list(value) if isinstance(value, Iterable) else [value]
    if not all(isinstance(p, str) for p in parts):
        raise InputError(f"{name} must be channel names", got=repr(value))
    listed = tuple(p.strip() for p in parts if p.strip())
    if not listed:
        raise InputError(f"{name} needs at least one name", got=repr(value))
    if len(set(listed)) != len(listed):
        raise InputError(f"{name} names a channel twice", got=", ".join(listed), mend="name every channel once")
    return listed


def role_mend(*roles: str) -> str:
    """How a channel of another name gets a role: on the command line, and in Python.

    Examples
    --------
    >>> role_mend("force")
    "--role force=CHANNEL, in Python record.with_roles({'force': 'CHANNEL'}) or a column of that name"
    """
    options = " or ".join(f"--role {shlex.quote(f'{role}=CHANNEL')}" for role in roles)
    return f"{options}, in Python record.with_roles({{'{roles[0]}': 'CHANNEL'}}) or a column of that name"


def known_name(wanted: str, available: Sequence[str], what: str, mend: str = "", where: str = "") -> str:
    """`wanted` if it is in `available`; otherwise an error that lists what there is (in `where`, if stated)."""
    if wanted not in available:
        hint = " Or ".join(part for part in (_near(wanted, available), mend) if part)
        known = f"there {'is' if len(available) == 1 else 'are'} {', '.join(available) or 'none'}"
        lacking = f"{where} has no" if where else "no"
        raise InputError(f"{lacking} {what} '{wanted}'", why=known, mend=hint or None)
    return wanted


def _near(value: str, allowed: Sequence[str]) -> str | None:
    close = difflib.get_close_matches(str(value), list(allowed), n=1)
    return f"did you mean '{close[0]}'?" if close else None
