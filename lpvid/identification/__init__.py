"""Identification: `identify(records, structure) -> Identification`, one structure or estimator per file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from lpvid import _checks
from lpvid.condition import segments, with_derived
from lpvid.condition.tables import as_records
from lpvid.errors import InputError
from lpvid.files.streaming import Chunks
from lpvid.identification.covariance import residual_memory
from lpvid.identification.result import Identification
from lpvid.identification.separation import independence_remarked, separated
from lpvid.identification.stage_fit import require_motion
from lpvid.identification.structure import Structure
from lpvid.model.hull import Hull
from lpvid.record import Record
from lpvid.simulation import predict
from lpvid.training_fingerprint import of_files, ranges, usual_range
from lpvid.training_rows import TrainingRows
from lpvid.validation import figures, validate

COLOURED_LIMIT = 400_000
"""samples up to which a coloured residual's covariance is worth two more passes over the data."""

SANDWICH = "least squares, sandwich over the coloured residual"


def identify(records: Record | Sequence[Record] | Chunks, structure: Structure, *, sample_rate: float | None = None,
             held_out: Record | Sequence[Record] | Chunks | None = None,
             units: Mapping[str, str] | None = None) -> Identification:
    """Fit a structure to measured records.

    Parameters
    ----------
    records : Record, sequence of Record, or Chunks
        Training data; cut at gaps and NaN of the channels in use, never interpolated. `Chunks` of files larger than
        memory are read part by part, for `ARX` and `Recursive` (`lpvid.identify_stream`).
    structure : Structure
        E.g. ``ARX(na=4, nb=4, input="velocity", output="force", basis=Polynomial("current", degree=1))``.
    sample_rate : float, optional
        Resample to this rate [Hz], anti-aliased; needed for jittered or mixed time bases.
    held_out : Record or sequence of Record, optional
        Data the fit does not see; its figures are reported beside the training figures.
    units : mapping of str to str, optional
        Of columns whose name states none, where the data are no Records; of a plain array, its columns in order.

    Returns
    -------
    Identification

    Raises
    ------
    InputError
        Missing or unusable channels, a scheduling variable that does not move, a scheduling filter to be fitted where
        it moves in no record, too few samples, parameters that these data cannot separate.

    Examples
    --------
    >>> import numpy as np
    >>> from lpvid.identification.arx import ARX
    >>> from lpvid.scheduling import Polynomial
    >>> rng = np.random.default_rng(0)
    >>> u, p = rng.normal(size=400), rng.uniform(0, 2, 400)
    >>> y = np.zeros(400)
    >>> for k in range(1, 400):
    ...     y[k] = (0.5 + 0.2 * p[k]) * y[k - 1] + u[k - 1]
    >>> record = Record({"u": u, "p": p, "y": y}, sample_time=0.01)
    >>> found = identify(record, ARX(na=1, nb=1, input="u", output="y", basis=Polynomial("p", degree=1)))
    >>> found.model.frozen_poles([1.0]).real.round(6)
    array([0.7])
    """
    if isinstance(records, Chunks):
        return _streamed(records, structure, sample_rate, held_out)
    _checks.instance(structure, Structure, "identify fits a structure", "lpv.ARX(na=2, nb=2, input=..., output=...)")
    listed = as_records(records, units=units)
    if units is not None and held_out is not None:
        held_out = as_records(held_out, "held-out", units)
    if not listed:
        raise InputError("no records to identify from")
    listed = with_derived(listed, structure.channels)
    pieces = segments(listed, structure.channels, sample_rate=sample_rate, minimum=structure.start + 2,
                      remedy="a lower order")
    require_motion(pieces, structure)
    found = _remember(structure.estimate(pieces), pieces, listed)
    notes = tuple(dict.fromkeys((*(n for r in pieces for n in r.notes), *found.notes)))
    found = _coloured(found.replace(training=figures(found.model, pieces, "training"), notes=notes), pieces)
    apart = separated(found, pieces)
    if apart is not found:
        found = apart.replace(training=figures(apart.model, pieces, "training"))
    kept = None if held_out is None else validate(found.model, held_out, label="held-out")
    if found.unconstrained is not None:
        before = figures(found.unconstrained, pieces, "training")
        late = () if held_out is None else (validate(found.unconstrained, held_out, label="held-out"),)
        found = found.replace(unconstrained_figures=(before, *late))
    if kept is None or held_out is None or isinstance(held_out, Chunks):
        return found.replace(held_out=kept)
    return independence_remarked(found.replace(held_out=kept), held_out)


def _streamed(chunks: Chunks, structure: Structure, sample_rate: float | None,
              held_out: Record | Sequence[Record] | Chunks | None) -> Identification:
    """The estimate and its figures from files that do not fit into memory."""
    from lpvid.identification.streaming import identify_stream

    if sample_rate is not None:
        raise InputError("a stream keeps its own rate", got=f"{sample_rate:g} Hz", mend="resample the files before")
    found = identify_stream(chunks, structure)  # type: ignore[arg-type]
    found = found.replace(training=validate(found.model, chunks, label="training"))
    return found if held_out is None else found.replace(held_out=validate(found.model, held_out, label="held-out"))


def _coloured(found: Identification, pieces: Sequence[Record]) -> Identification:
    """The same estimate with a covariance that allows for a coloured residual, where its residual is coloured."""
    assert found.training is not None
    white = all(t.passed for t in found.training.residual_tests if t.name == "whiteness")
    if white or sum(r.n_samples for r in pieces) > COLOURED_LIMIT:
        return found
    residuals = [r.matrix([s.name for s in found.model.outputs])[:, 0] - predict(found.model, r, 1).output[:, 0]
                 for r in pieces]
    memory = residual_memory([e[found.model.start:] for e in residuals])
    covariance = found.structure.coloured_covariance(pieces, found, memory)
    if covariance is None:
        return found
    stated = f"the residual is correlated over {memory} samples: standard errors in sandwich form"
    return found.with_covariance(covariance).replace(notes=(*found.notes, stated), covariance_kind=SANDWICH)


def _remember(found: Identification, pieces: Sequence[Record], listed: Sequence[Record]) -> Identification:
    """Restore what the model states of its training data: prints of rows, ranges, roles, region of scheduling space."""
    model = found.model
    names = list(model.box.names)
    read = list(dict.fromkeys((*(s.name for s in (*model.inputs, *model.outputs)), *names)))
    training = {**model.metadata.get("training", {}), "rows": TrainingRows.of(listed, model.outputs[0].name).to_dict(),
                "ranges": ranges(pieces, read), "usual": {n: usual_range([r[n] for r in pieces]) for n in names}}
    metadata = {**model.metadata, "training": training, **of_files(listed, read)}
    if len(names) > 1:
        metadata["hull"] = Hull.of(names, np.vstack([r.matrix(names) for r in pieces])).to_dict()
    return found.replace(model=model.replace(metadata=metadata))


__all__ = ["Identification", "Structure", "identify"]
