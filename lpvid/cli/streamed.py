"""What `identify`, `validate` and `inspect` do with data that are read in parts."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lpvid.errors import InputError

if TYPE_CHECKING:
    from lpvid.cli.modelling import ReportedIdentification
    from lpvid.cli.structures import Request
    from lpvid.files.streaming import Chunks
    from lpvid.record import Record

DRAWN = 20_000
"""Samples at the beginning of the data that the report draws and that decide on the first input lag."""
STATE = "stream-state.npz"
"""File in --out that holds what was folded so far; gone when the estimate is complete."""


def parts(data: Sequence[str], rows: int, *, roles: Sequence[str] | None, flip: Sequence[str] | None,
          sample_rate: float | None, like: Any = None) -> Chunks:
    """DATA in parts, with roles applied.

    Parameters
    ----------
    data : sequence of str
        Files, patterns and folders.
    rows : int
        Samples of a part.
    roles : sequence of str or None
        ``ROLE=CHANNEL``, repeated or with commas.
    flip : sequence of str or None
        Must be empty or None.
    sample_rate : float or None
        Rate [Hz] of files without a time column.
    like : model or sequence of models, optional
        As for `lpvid.read`.

    Returns
    -------
    Chunks
        Read when they are iterated.

    Raises
    ------
    InputError
        A sign to turn.
    """
    from lpvid.cli.data import parse_roles
    from lpvid.files.streaming import read_chunks

    if flip:
        raise InputError("--chunk reads files as they are", got="--flip", mend="turn the sign where the files are "
                         "written, or leave --chunk out")
    return read_chunks(data, rows, roles=parse_roles(roles), sample_rate=sample_rate, like=like)


def beginning(chunks: Chunks) -> Record:
    """The first samples, in memory.

    Parameters
    ----------
    chunks : Chunks
        At least one part.

    Returns
    -------
    Record
        At most `DRAWN` samples of the first part.
    """
    first = next(iter(chunks))
    cut = first.slice(0, DRAWN)
    return replace(cut, **({"time": None} if cut.time is None else {"sample_time": None}))


def first_samples(chunks: Chunks) -> list[Record]:
    """The first two samples of every record, for the units of its channels.

    Parameters
    ----------
    chunks : Chunks

    Returns
    -------
    list of Record
    """
    return [r for s in chunks.sets for r in itertools.islice(replace(chunks, sets=(s,), rows=2), 1)]


def fit_parts(request: Request, chunks: Chunks, held_out: Chunks | None, refused: Mapping[str, Any],
              folder: Path | None, report_progress: Callable[[str], None]) -> ReportedIdentification:
    """Audit, choose what was left open, fit, validate: part by part.

    Parameters
    ----------
    request : Request
    chunks, held_out : Chunks
    refused : mapping
        Options that need whole records, by name; those that were given are refused.
    folder : Path or None
        Where the state goes, from which an interrupted estimate goes on.
    report_progress : callable
        Receives progress.

    Returns
    -------
    ReportedIdentification

    Raises
    ------
    InputError
        An option that needs whole records, or a structure other than arx and recursive, or a passive one.
    """
    from lpvid.auditing.streamed import audit_stream
    from lpvid.cli.modelling import ReportedIdentification, _settled, marked
    from lpvid.identification.streaming import identify_stream
    from lpvid.training_fingerprint import unstated_units
    from lpvid.validation.streamed import validate_stream

    for name, given in refused.items():
        if given:
            raise InputError(f"{name} needs the records whole", why="--chunk reads them in parts",
                             mend=f"leave {name} out, or leave --chunk out")
    if request.structure not in ("arx", "recursive") or "passive" in request.given:
        raise InputError("--chunk identifies arx and recursive", got=f"--structure {request.structure}"
                         + (" --passive" if "passive" in request.given else ""), mend="leave --chunk out")
    head = beginning(chunks)
    structure, notes = _settled(request, [head], report_progress)
    found = identify_stream(
        chunks,
        structure,  # type: ignore[arg-type]
        checkpoint=None if folder is None else folder / STATE,
        report_progress=lambda t: report_progress(f"fitting: {t}"),
    )
    used = structure.channels
    found = found.replace(training=validate_stream(found.model, chunks.only(used), label="training",
                                                   report_progress=lambda t: report_progress(f"validating: {t}")))
    shown: tuple[Record, ...] = ()
    if held_out is not None:
        shown = (beginning(held_out),)
        kept = validate_stream(
            found.model, held_out.only(used), label="held-out",
            report_progress=lambda t: report_progress(f"held-out data: {t}")
        )
        found = found.replace(held_out=kept)
    audited = audit_stream(chunks, scheduling=request.schedule or None, inputs=request.input,
                           outputs=request.output, report_progress=lambda t: report_progress(f"auditing: {t}"))
    stated = (*notes, *(("the first input lag was chosen on the first "
                       f"{head.n_samples} samples",) if request.searches_delay else ()),
            f"the report draws the first {head.n_samples} samples")
    stated += unstated_units(first_samples(chunks), request.channels)
    found = marked(found.replace(notes=(*stated, *found.notes)), bool(audited.of("reversed-polarity")))
    return ReportedIdentification(found, (), audited, (head,), shown, request.form)
