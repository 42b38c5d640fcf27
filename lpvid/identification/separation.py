r"""What the data determine of several inputs that move together, and what only a prior does.

The free run is linear in the input coefficients b, given the poles: y = X b + the rest, one block of columns X_i for
every input. M = XᵀX/N is the information per sample (at unit noise), G its diagonal blocks: the information that the
same inputs would carry if they were independent. M v = μ G v (generalised eigenvalues) splits b into contributions that
neither M nor G mixes: μ = 1 where the inputs move independently; for two inputs μ = 1 ± ρ with ρ the canonical
correlations between what either can contribute (Hotelling 1936), so that μ → 0 is a direction in which their
contributions cancel on these data, and only on these.

Not all of μ is information. What is white in an input and not explained by the others may be its sensor's noise; passed
through the model it takes the part ν of μ (an error in the regressors: least squares then weighs the inputs as sensors
of one motion, whatever their true shares). And an error of the model of power s², the whole power of the free-run
residual, which does not average out as noise does, passes for a contribution of power s²/(μ − ν). The prior is that the
contributions which cancel on these data have together the power of as many outputs σ_y² as there are inputs m, spread
over their d directions (Zellner's g-prior, 1986), or what the estimate β itself shows beyond such an error, if that is
more (empirical Bayes, E β² = p + e):

::

    e = s²/(μ − ν),     p = max(m σ_y²/d, β² − e),     w = p/(p + c e),     β ← w β

    var β = max((1 − w)² p + w² min(e, p + β²), (1 − w) p)

The last is the posterior, for c = 1; c is the largest value up to 1 at which Σ (1 − w)² β² μ, by
which the mean square error on these data rises, stays within `NO_WORSE` of it: the fit is not given away for a prior.
Every scale is a power of the data; directions with μ above 1/(2·`INFLATION`) stay as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from lpvid._threads import single_thread
from lpvid.auditing.coherence import INFLATION, InputCoherence, input_coherence, one_per_motion
from lpvid.auditing.view import View
from lpvid.caveat import Caveat
from lpvid.condition.tables import as_records
from lpvid.identification.layout import ParameterLayout
from lpvid.identification.result import Identification
from lpvid.identification.stage_fit import shorten
from lpvid.identification.state_space_layout import ARRAYS, StateSpaceLayout
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from lpvid.simulation import simulate
from lpvid.validation import figures as validation_figures
from lpvid.validation.coherent import independence_remark

SAMPLES = 30_000
"""samples from which the information is taken, the head of every record."""
MOST = 400
"""input coefficients up to which their directions are worked out."""
NO_WORSE = 0.02
"""share by which the mean square error may rise: 1 % of what the fit lacks to 100 %."""
TINY = 1e-15
"""information below which a direction counts as unseen: rounding of the largest, which is 1 to m."""
SEEN = 1e-7
"""singular values of one input's own contributions below this share of the largest are left out: the runs that they
come from are exact to about 1e-12, and the split must hold on their squares."""


def coherence_of(records: Sequence[Record], names: Sequence[str]) -> InputCoherence | None:
    """Coherence of the inputs over all records together, where they are several and do not move enough on their own.

    Parameters
    ----------
    records : sequence of Record
        Uniform and finite.
    names : sequence of str
        Inputs.

    Returns
    -------
    InputCoherence or None
        None for one input or one motion, or where the inputs are separable.
    """
    views = [View(r, ()) for r in records]
    motions = one_per_motion(views, names)
    apart = input_coherence(views, motions) if len(motions) > 1 else None
    if apart is None or apart.separable:
        return None
    found = input_coherence(views, names)
    return None if found is None or found.separable else found


def separated(found: Identification, records: Sequence[Record]) -> Identification:
    """The estimate with its coefficients shrunk, and their variance stated, in directions that the data leave open.

    Parameters
    ----------
    found : Identification
    records : sequence of Record
        What it was fitted to.

    Returns
    -------
    Identification
        The same where the inputs are separable, or where the model is not linear in them.
    """
    names = [s.name for s in found.model.inputs]
    coherence = coherence_of(records, names)
    if coherence is None:
        return found
    worst = int(np.argmin(coherence.share))
    others = ", ".join(n for i, n in enumerate(names) if i != worst)
    stated = (f"inputs move together: {100 * (1 - coherence.share[worst]):.4g} % of the power of {names[worst]} is "
            f"explained by {others} in these data")
    marked = {"inputs": names, "explained": (1 - coherence.share).tolist(), "regularised": False}
    with single_thread():
        sample = shorten(records, SAMPLES, 20 * (found.model.start + 5))
        split = _split(found, sample, coherence)
    if split is None:
        return _noted(found, marked, f"{stated}; this kind of model is not regularised: the data do not determine the "
                      "effect of each input apart from the others, and the standard errors do not include that")
    new = split.apply(found)
    if not _mean_square(new, sample) <= (1 + 2 * NO_WORSE) * _mean_square(found, sample):
        new = replace(split, weight=np.ones_like(split.weight)).apply(found)  # rounding rules: the variance alone
    lost = f"{split.undetermined:.1f} of {split.size} input coefficients are not determined by them"
    return _noted(new, {**marked, "regularised": True, "undetermined": split.undetermined},
                  f"{stated}: {lost}; there the estimate is drawn to the least contributions that explain the output, "
                  "and its standard errors and bands are those of the prior (a contribution as strong as the output)")


def independence_remarked(found: Identification, held_out: Record | Sequence[Record] | None) -> Identification:
    """The estimate, with a remark where held-out inputs are as coherent as those of the fit: figures test the sum only.

    Parameters
    ----------
    found : Identification
        Estimate, whose model's metadata state whether its inputs moved together.
    held_out : Record, sequence of Record or None
        Data that were not fitted; None for none.

    Returns
    -------
    Identification
        The same where there is nothing to remark.
    """
    stated = None if held_out is None else independence_remark(found.model, as_records(held_out), "held-out")
    return found if stated is None else found.replace(notes=(*found.notes, stated))


def _mean_square(found: Identification, records: Sequence[Record]) -> float:
    """Of the free-run errors, outputs in equal standing; infinite where a run diverges."""
    figures = validation_figures(found.model, records, "training").overall.free_run.esr
    return np.inf if figures is None else float(figures)


def _noted(found: Identification, marked: dict, note: str) -> Identification:
    model = found.model.replace(metadata={**found.model.metadata, "coherent_inputs": marked})
    return found.replace(model=model, notes=(*found.notes, Caveat(note)))


@dataclass(frozen=True, eq=False)
class Split:
    """Directions of the input coefficients that the data leave open.

    Attributes
    ----------
    places : (k,) int array
        Where the input coefficients stand among all parameters.
    directions, duals : (k, d) arrays
        v, with vᵀ G v = 1; and G v, so that β = (G v)ᵀ b.
    weight, variance : (d,) arrays
        w, and the variance of β.
    open : (d,) array
        How far the prior decides, e/(p + e): 1 where the data give no information.
    """

    places: np.ndarray
    directions: np.ndarray
    duals: np.ndarray
    weight: np.ndarray
    variance: np.ndarray
    open: np.ndarray

    @property
    def size(self) -> int:
        """Number of input coefficients."""
        return len(self.places)

    @property
    def undetermined(self) -> float:
        """Number of directions that the prior decides, Σ e/(p + e)."""
        return float(np.sum(self.open))

    def apply(self, found: Identification) -> Identification:
        """Shrunk coefficients and their covariance.

        Parameters
        ----------
        found : Identification
            The estimate that the split was made of.

        Returns
        -------
        Identification
        """
        whole = np.eye(found.parameters.size)
        inner = np.eye(self.size) - (self.directions * (1 - self.weight)) @ self.duals.T
        whole[np.ix_(self.places, self.places)] = inner
        covariance = whole @ found.covariance @ whole.T
        open_part = (self.directions * self.variance) @ self.directions.T
        covariance[np.ix_(self.places, self.places)] += open_part
        metadata = found.model.metadata
        model = found.layout.fill(found.model, whole @ found.parameters).replace(metadata=metadata)
        kind = f"{found.covariance_kind}; a prior where the inputs move together"
        return found.replace(model=model, covariance_kind=kind).with_covariance(0.5 * (covariance + covariance.T))


def _split(found: Identification, records: Sequence[Record], coherence: InputCoherence) -> Split | None:
    """The open directions; None where the model is not linear in its inputs, or its runs diverge."""
    model = found.model
    owner = _owners(found)
    if owner is None or not np.isfinite(found.covariance).all():
        return None
    places = np.flatnonzero(owner >= 0)
    if not 0 < len(places) <= MOST:
        return None
    root, fault = _root(found, records, places)
    sensors, _ = _root(found, [_noise(r, coherence) for r in records], places)
    if root is None or sensors is None:
        return None
    owner = owner[places]
    frame, dual = _frames(root, owner, len(model.inputs))
    _, values, vectors = np.linalg.svd(root @ frame)
    values = np.append(values, np.zeros(len(vectors) - len(values)))
    chosen = values**2 <= 1 / (2 * INFLATION)
    mu, turned = values[chosen] ** 2, vectors[chosen].T
    v, g = frame @ turned, dual @ turned
    noise = sum(np.sum((sensors[:, owner == i] @ v[owner == i]) ** 2, axis=0) for i in range(len(model.inputs)))
    known = np.maximum(mu - noise, TINY)
    shown = (g.T @ found.layout.read(model)[places]) ** 2
    error, inputs = fault / known, len(model.inputs)
    power = np.maximum(inputs / max(int(np.sum(error > inputs)), 1), shown - error)
    weight = _weights(power, error, shown * mu, fault)
    bounded = np.minimum(error, power + shown)
    variance = np.maximum((1 - weight) ** 2 * power + weight**2 * bounded, (1 - weight) * power)
    return Split(places, v, g, weight, variance, error / (power + error))


def _noise(record: Record, coherence: InputCoherence) -> Record:
    """The record with its inputs replaced by white noise of the power that their sensors may have."""
    rng = np.random.default_rng(0)
    channels = {name: np.sqrt(share) * float(np.std(record[name])) * rng.standard_normal(record.n_samples)
                for name, share in zip(coherence.names, coherence.floor, strict=True)}
    return reduce(lambda r, name: r.with_channel(r.resolve(name), channels[name]), coherence.names, record)


def _weights(power: np.ndarray, error: np.ndarray, effect: np.ndarray, fault: float) -> np.ndarray:
    """w at the largest c up to 1 that costs no more than `NO_WORSE` of the mean square error; `effect` is β² μ."""
    strengths = np.append(0.0, np.geomspace(1e-12, 1.0, 121))
    weights = power / (power + strengths[:, None] * error)
    cost = np.sum((1 - weights) ** 2 * effect, axis=1)
    return weights[int(np.flatnonzero(cost <= NO_WORSE * fault)[-1])]


def _owners(found: Identification) -> np.ndarray | None:
    """(k,) input that every parameter belongs to, −1 for none; None where a parameter is of several kinds."""
    model, layout = found.model, found.layout
    if isinstance(model, LPVTransferFunction) and isinstance(layout, ParameterLayout) and model.input_stage is None:
        return np.where(layout.table[:, 0] == 1, layout.table[:, 3], -1)
    if not isinstance(model, LPVStateSpace) or not isinstance(layout, StateSpaceLayout):
        return None
    owner = np.full(layout.size, -2)
    for parameter, array, _, _, column, _ in layout.table.tolist():
        mine = column if ARRAYS[array] in ("B", "D") else -1
        if owner[parameter] not in (-2, mine):
            return None
        owner[parameter] = mine
    return owner


def _root(found: Identification, records: Sequence[Record], places: np.ndarray) -> tuple[np.ndarray | None, float]:
    """R with RᵀR = XᵀX/N, and the power of the free-run residual; outputs in units of their spread."""
    model, layout = found.model, found.layout
    names = [s.name for s in model.outputs]
    centred = np.vstack([y - y.mean(axis=0) for y in (r.matrix(names) for r in records)])
    unit = np.maximum(centred.std(axis=0), 1e-300)
    silent = _silent(model)
    others = layout.read(model)
    others[_driven(found)] = 0.0
    root, squares, rows = np.zeros((0, len(places))), 0.0, 0
    for record in records:
        run = simulate(model, record)
        columns = [simulate(layout.fill(silent, _with(others, place)), record, "zero") for place in places]
        if run.diverged_at is not None or any(c.diverged_at is not None for c in columns):
            return None, 0.0
        x = np.column_stack([(c.output / unit)[model.start:].ravel() for c in columns])
        squares += float(np.sum((((record.matrix(names) - run.output) / unit)[model.start:]) ** 2))
        root = np.asarray(np.linalg.qr(np.vstack([root, x]), mode="r"))
        rows += len(x)
    return root / np.sqrt(rows), squares / rows


def _driven(found: Identification) -> np.ndarray:
    """Parameters that make an output without a past: those of inputs and of the terms of scheduling alone."""
    layout = found.layout
    if isinstance(layout, ParameterLayout):
        return layout.table[:, 0] > 0
    assert isinstance(layout, StateSpaceLayout)
    codes = [ARRAYS.index(n) for n in ("B", "D", "state_offset", "output_offset")]
    out = np.zeros(layout.size, dtype=bool)
    out[layout.table[np.isin(layout.table[:, 1], codes), 0]] = True
    return out


def _silent(model: LPVTransferFunction | LPVStateSpace) -> LPVTransferFunction | LPVStateSpace:
    if isinstance(model, LPVTransferFunction):
        assert model.c is not None
        return model.replace(b=np.zeros_like(model.b), c=np.zeros_like(model.c))
    assert model.state_offset is not None and model.output_offset is not None
    return model.replace(B=np.zeros_like(model.B), D=np.zeros_like(model.D),
                         state_offset=np.zeros_like(model.state_offset),
                         output_offset=np.zeros_like(model.output_offset))


def _with(others: np.ndarray, place: int) -> np.ndarray:
    theta = others.copy()
    theta[place] = 1.0
    return theta


def _frames(root: np.ndarray, owner: np.ndarray, inputs: int) -> tuple[np.ndarray, np.ndarray]:
    """T with Tᵀ G T = 1, and G T, input by input; what an input's own motion does not excite is left out.

    From the singular values of each block of R: G itself would square their ratio.
    """
    frames, duals = [], []
    for i in range(inputs):
        mine = np.flatnonzero(owner == i)
        block = root[:, mine]
        scale = np.maximum(np.linalg.norm(block, axis=0), 1e-300)
        _, values, vectors = np.linalg.svd(block / scale, full_matrices=False)
        kept = values > SEEN * values.max(initial=0.0)
        for out, columns in ((frames, vectors[kept].T / values[kept] / scale[:, None]),
                             (duals, vectors[kept].T * values[kept] * scale[:, None])):
            whole = np.zeros((len(owner), int(kept.sum())))
            whole[mine] = columns
            out.append(whole)
    return np.hstack(frames), np.hstack(duals)
