"""From the command line's words to records: files, roles, signs, held-out parts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fnmatch import fnmatch
from fractions import Fraction
from pathlib import Path
from typing import Any

from lpvid.errors import InputError, TooFewSamples
from lpvid.record import Record


def split_names(given: Iterable[str] | None) -> tuple[str, ...]:
    """Names from repeated options and comma-separated lists, in order.

    Parameters
    ----------
    given : iterable of str or None
        As written; None where the option was left out.

    Returns
    -------
    tuple of str
        Without spaces around them and without empty ones.

    Examples
    --------
    >>> split_names(["a,b", "c"])
    ('a', 'b', 'c')
    """
    return tuple(part.strip() for text in given or () for part in text.split(",") if part.strip())


def numbers(text: str, option: str) -> int | tuple[int, ...]:
    """A whole number, or several with commas.

    Parameters
    ----------
    text : str
        As written.
    option : str
        Name of the option, for the message.

    Returns
    -------
    int or tuple of int
        A tuple where there are several.

    Raises
    ------
    InputError
        A part that is no whole number.

    Examples
    --------
    >>> numbers("4", "--nb"), numbers("4,2", "--nb")
    (4, (4, 2))
    """
    try:
        found = tuple(int(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"{option} takes whole numbers", got=repr(text),
                         mend=f"e.g. {option} 4 or {option} 4,3") from None
    return found[0] if len(found) == 1 else found


def share(text: str) -> float:
    """A part of every record: ``1/3``, ``0.33``, ``33%`` or ``last-third``.

    Parameters
    ----------
    text : str
        As written; also ``half``, ``third``, ``quarter``, ``fifth`` and ``tenth``, with or without ``last-``.

    Returns
    -------
    float
        Between 0 and 1, both excluded.

    Raises
    ------
    InputError
        A text that is no share, or one of 0 and less, or of 1 and more.

    Examples
    --------
    >>> share("1/4"), share("25%"), round(share("last-third"), 6)
    (0.25, 0.25, 0.333333)
    """
    word = text.strip().lower().removeprefix("last-").removeprefix("last ")
    spelled = {"half": "1/2", "third": "1/3", "quarter": "1/4", "fifth": "1/5", "tenth": "1/10"}
    word = spelled.get(word, word)
    try:
        value = Fraction(word.removesuffix("%").strip()) / (100 if word.endswith("%") else 1)
    except (ValueError, ZeroDivisionError):
        raise InputError("--hold-out takes a share of every record", got=repr(text),
                         mend="e.g. --hold-out 1/3") from None
    if not 0 < value < 1:
        raise InputError("--hold-out must lie between 0 and 1", got=text, mend="e.g. --hold-out 1/3")
    return float(value)


def interval(text: str, option: str) -> tuple[str, tuple[float, float]]:
    """``A:B`` or ``NAME=A:B`` as (name or "", (low, high)).

    Parameters
    ----------
    text : str
        As written.
    option : str
        Name of the option, for the message.

    Returns
    -------
    str
        The variable, "" where none is named.
    (float, float)
        Low and high end, in the unit of the variable.

    Raises
    ------
    InputError
        No colon, an end that is no finite number, or a lower end that is not below the upper one.

    Examples
    --------
    >>> interval("current=0:2.5", "--range")
    ('current', (0.0, 2.5))
    """
    name, _, ends = text.rpartition("=")
    low, colon, high = ends.partition(":")
    if not colon:
        raise InputError(f"{option} takes A:B or NAME=A:B", got=repr(text))
    pair = (_number(low, option), _number(high, option))
    if not pair[0] < pair[1]:
        raise InputError(f"{option} needs its lower end below its upper end", got=repr(text))
    return name.strip(), pair


def rates(given: Sequence[str] | None, names: Sequence[str]) -> float | dict[str, float | None] | None:
    """``R`` for every variable, or ``NAME=R`` for some; None where nothing was given.

    Parameters
    ----------
    given : sequence of str or None
        As written; None where the option was left out.
    names : sequence of str
        Scheduling variables of the model.

    Returns
    -------
    float, dict of str to float or None, or None
        Largest rates of change, in the unit of the variable per second; None for one that was not named: any rate.

    Raises
    ------
    InputError
        A value that is no finite number, one without a name beside others, or a variable that the model does not have
        or that is named twice.
    """
    from lpvid import _checks

    listed = split_names(given)
    if not listed:
        return None
    if len(listed) == 1 and "=" not in listed[0]:
        return _number(listed[0], "--rate")
    found: dict[str, float | None] = dict.fromkeys(names, None)
    for text in listed:
        name, equals, value = text.partition("=")
        if not equals:
            raise InputError("--rate takes R, or NAME=R for each variable", got=repr(text))
        name = _checks.known_name(name.strip(), names, "scheduling variable")
        if found[name] is not None:
            raise InputError(f"--rate names '{name}' twice", got=", ".join(listed))
        found[name] = _number(value, "--rate")
    return found


def _number(text: str, option: str) -> float:
    from lpvid import _checks

    return _checks.real(text.strip(), f"the value of {option}")


def asked_rate(text: str | None) -> tuple[float | None, bool]:
    """The rate that --sample-rate names [Hz], if any, and whether the data keep their own (``raw``).

    Parameters
    ----------
    text : str or None
        As written; None where the option was left out.

    Returns
    -------
    float or None
        Rate [Hz], positive.
    bool
        Whether "raw" was written.

    Examples
    --------
    >>> asked_rate("500.8"), asked_rate("raw"), asked_rate(None)
    ((500.8, False), (None, True), (None, False))
    """
    from lpvid import _checks

    if text is None:
        return None, False
    if text.strip().lower() == "raw":
        return None, True
    return _checks.positive(_number(text, "--sample-rate"), "--sample-rate", "Hz"), False


def working_rate(records: Sequence[Record], rate: float | None, raw: bool) -> tuple[float | None, tuple[str, ...]]:
    """Rate to resample to [Hz] and notes on it: as requested, the data's own, or decimated where they are too fast.

    One policy for every command that fits: `lpvid.condition.preparing.decimation`.

    Parameters
    ----------
    records : sequence of Record
        As read.
    rate : float or None
        As requested [Hz].
    raw : bool
        Whether the data keep their own rate.

    Returns
    -------
    float or None
        None for the data's own rate.
    tuple of str
        What was decimated, and why; empty where nothing was.
    """
    from lpvid.condition.preparing import decimation

    if rate is not None:
        return rate, ()
    found, notes = decimation(records)
    return (None, ()) if raw else (found, notes)


def models_rate(records: Sequence[Record], rate: float | None, raw: bool, clockless: bool) -> float | None:
    """The rate at which a model is asked to run [Hz]; None for its own, to which the data are resampled.

    Parameters
    ----------
    records : sequence of Record
    rate : float or None
        As stated [Hz]; of files without a clock the one they were measured at, and no request.
    raw : bool
        Whether the data keep their own rate.
    clockless : bool
        Whether some file had no clock.

    Returns
    -------
    float or None
    """
    from lpvid.condition.preparing import common_rate

    return common_rate(records) if raw else None if clockless else rate


def read_records(paths: Sequence[str], *, roles: Sequence[str] | None = None, flip: Sequence[str] | None = None,
                 sample_rate: float | None = None) -> list[Record]:
    """Records behind the command line's DATA, with roles and signs applied.

    Parameters
    ----------
    paths : sequence of str
        Files, patterns, folders.
    roles : sequence of str, optional
        ``ROLE=CHANNEL``, repeated or with commas.
    flip : sequence of str, optional
        Channels whose sign to turn, ``CHANNEL`` in every file or ``CHANNEL@PATTERN`` in those of matching name.
    sample_rate : float, optional
        Rate [Hz] of files without a time column.

    Returns
    -------
    list of Record
    """
    return read_clocked(paths, roles=roles, flip=flip, sample_rate=sample_rate)[0]


def read_clocked(paths: Sequence[str], *, roles: Sequence[str] | None = None, flip: Sequence[str] | None = None,
                 sample_rate: float | None = None, like: Any = None) -> tuple[list[Record], bool]:
    """As `read_records`, and whether some file had no clock, so that `sample_rate` was its own rate.

    Parameters
    ----------
    paths, roles, flip, sample_rate
        As for `read_records`.
    like : model or sequence of models, optional
        Whose training data these files are read like, as for `lpvid.read`.

    Returns
    -------
    list of Record
        In the order of the files.
    bool
        Whether some file had no clock.
    """
    from lpvid.files import find, read, record_names

    mapping, without = parse_roles(roles), False
    files = find(paths)
    records: list[Record] = []
    for file, label in zip(files, record_names(files), strict=True):
        try:
            records += read(file, name=label, roles=mapping, like=like)
        except InputError:
            if sample_rate is None:
                raise
            records += read(file, name=label, roles=mapping, sample_rate=sample_rate, like=like)
            without = True
    return _flipped(records, files, split_names(flip)), without


def read_parts(training: Sequence[str], held_out: Sequence[str] | None, *, roles: Sequence[str] | None = None,
               flip: Sequence[str] | None = None,
               sample_rate: float | None = None) -> tuple[list[Record], list[Record]]:
    """Records of DATA and of --held-out, read as one set: a ``--flip CHANNEL@PATTERN`` may mean files of either.

    Parameters
    ----------
    training : sequence of str
        Files, patterns and folders of DATA.
    held_out : sequence of str or None
        Those of --held-out.
    roles, flip, sample_rate
        As for `read_records`.

    Returns
    -------
    list of Record
        Training data.
    list of Record
        Held-out data, empty where there are none.

    Raises
    ------
    InputError
        A file that is in both.
    """
    return read_parts_clocked(training, held_out, roles=roles, flip=flip, sample_rate=sample_rate)[:2]


def read_parts_clocked(training: Sequence[str], held_out: Sequence[str] | None, *, roles: Sequence[str] | None = None,
                       flip: Sequence[str] | None = None, sample_rate: float | None = None,
                       like: Any = None) -> tuple[list[Record], list[Record], bool]:
    """As `read_parts`, and whether some file had no clock, so that `sample_rate` was its own rate.

    Parameters
    ----------
    training, held_out, roles, flip, sample_rate
        As for `read_parts`.
    like : model or sequence of models, optional
        As for `read_clocked`.

    Returns
    -------
    list of Record
        Training data.
    list of Record
        Held-out data, empty where there are none.
    bool
        Whether some file of either had no clock.

    Raises
    ------
    InputError
        A file that is in both.
    """
    from lpvid.files import find

    if held_out:
        _no_shared_files(training, held_out)
    paths = [*training, *(held_out or ())]
    records, without = read_clocked(paths, roles=roles, flip=flip, sample_rate=sample_rate, like=like)
    count = len(find(training))
    return records[:count], records[count:], without


def _flipped(records: Sequence[Record], files: Sequence[Path], wanted: Sequence[str]) -> list[Record]:
    """The records with signs turned; a record at a time, so that one file may be turned and the next not."""
    result = list(records)
    for text in wanted:
        channel, at, pattern = text.rpartition("@")
        if not at or any(r.has(text) for r in records):
            result = [r.flip(text) for r in result]
            continue
        chosen = [_matches(pattern, file, r.name) for file, r in zip(files, records, strict=True)]
        if not (channel and any(chosen)):
            raise InputError(f"--flip {text}: no file matches '{pattern}'", got=", ".join(r.name for r in records[:6])
                             + (f" and {len(records) - 6} more" if len(records) > 6 else ""),
                             mend="--flip CHANNEL@NAME, where * stands for any letters, e.g. --flip 'force@*psi*'")
        result = [r.flip(channel) if turn else r for r, turn in zip(result, chosen, strict=True)]
    return result


def _matches(pattern: str, file: Path, name: str) -> bool:
    return any(fnmatch(text, pattern) for text in (name, file.stem, file.name, str(file)))


def parse_roles(given: Sequence[str] | None) -> dict[str, str]:
    """``ROLE=CHANNEL`` pairs as a mapping.

    Parameters
    ----------
    given : sequence of str or None
        As written, repeated or with commas; None where the option was left out.

    Returns
    -------
    dict of str to str
        Role to channel.

    Raises
    ------
    InputError
        A text without a role, an equals sign or a channel; a role that is named twice.

    Examples
    --------
    >>> parse_roles(["force=F_cell"])
    {'force': 'F_cell'}
    """
    roles: dict[str, str] = {}
    for text in split_names(given):
        role, equals, channel = text.partition("=")
        if not (equals and role.strip() and channel.strip()):
            raise InputError("--role takes ROLE=CHANNEL", got=repr(text), mend="e.g. --role force=F_cell")
        if role.strip() in roles:
            raise InputError(f"--role names '{role.strip()}' twice", got=", ".join(given or ()))
        roles[role.strip()] = channel.strip()
    return roles


def hold_out(records: Sequence[Record], text: str | None) -> tuple[list[Record], list[Record]]:
    """Training and held-out parts of raw records: the last part of each, by samples; all training without `text`.

    Parameters
    ----------
    records : sequence of Record
        As read.
    text : str or None
        As for `share`.

    Returns
    -------
    list of Record
        Training parts.
    list of Record
        Held-out parts, empty without `text`.
    """
    if text is None:
        return list(records), []
    from lpvid.condition import split_tail

    part = share(text)
    pairs = [split_tail(r, part) for r in records]
    return [a for a, _ in pairs], [b for _, b in pairs]


def with_cause(error: TooFewSamples, records: Sequence[Record], training: Sequence[Record], share_text: str | None,
               rate: float | None) -> TooFewSamples:
    """The error about short records with the option that made them short, where one did.

    Parameters
    ----------
    error : TooFewSamples
        Of the fit.
    records : sequence of Record
        As measured.
    training : sequence of Record
        What --hold-out leaves of them.
    share_text : str or None
        As written with --hold-out.
    rate : float or None
        As requested with --sample-rate [Hz].

    Returns
    -------
    TooFewSamples
        The same where no option is the cause.
    """
    causes, mends = [], []
    whole, kept = sum(r.n_samples for r in records), sum(r.n_samples for r in training)
    if share_text is not None:
        causes.append(f"--hold-out {share_text} leaves {kept} of {whole} samples for the fit")
        mends.append("hold out a smaller share")
    own = min(1 / r.time_base.period for r in records)
    if rate is not None and rate < own:
        left = sum(round(r.n_samples * r.time_base.period * rate) for r in training)
        causes.append(f"--sample-rate {rate:g} leaves {left} of {kept} samples, measured at {own:.6g} Hz")
        mends.append("choose a higher rate")
    if not causes:
        return error
    why = "; ".join(([error.why] if error.why else []) + causes)
    return TooFewSamples(error.what, got=error.got, why=why, mend=f"{' or '.join(mends)}, or {error.mend}")


def _no_shared_files(training: Sequence[str], held_out: Sequence[str]) -> None:
    """Refuse a file that is named for training and for testing."""
    from lpvid.files import find

    seen = {p.resolve() for p in find(training)}
    shared = [str(p) for p in find(held_out) if p.resolve() in seen]
    if shared:
        raise InputError("a file is both training and held-out data", got=", ".join(shared),
                         why="figures on data of the fit show little",
                         mend="name it once")
