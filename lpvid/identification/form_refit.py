"""A realised form and the same form re-estimated, beside the transfer function that both come from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid.condition import segments, with_derived
from lpvid.condition.tables import as_records
from lpvid.errors import InputError
from lpvid.identification import identify
from lpvid.identification.canonical_form import CanonicalForm
from lpvid.identification.result import Identification
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.realization import Gap, Realization, realize
from lpvid.record import Record
from lpvid.simulation import FIT_SAMPLES, simulate
from lpvid.validation import Validation, validate

SHOWN = ("transfer function", "form as realised", "form re-estimated")
"""The models whose figures stand beside each other, in this order."""
SAME = 1e-6
"""Difference of two free-run ESR below which it is rounding: a hundredth of the last digit that is printed of 0.01."""


@dataclass(frozen=True, eq=False)
class FormRefit:
    """Errors of a form before and after its own entries were estimated.

    Attributes
    ----------
    realization : Realization
        The form as realised; ``realization.source`` is the transfer function.
    found : Identification
        The form re-estimated (`CanonicalForm`), with its figures.
    gap : Gap
        Of the form as realised, on the training records.
    figures : mapping of str to tuple of Validation
        For each of `SHOWN` the figures on training and, where there are such data, on held-out records.
    remark : str
        Where the form re-estimated is worse than as realised from the states that these figures start from: why.
    """

    realization: Realization
    found: Identification
    gap: Gap
    figures: Mapping[str, tuple[Validation, ...]]
    remark: str = ""

    @property
    def model(self) -> LPVStateSpace:
        """The form re-estimated."""
        return self.found.model

    @property
    def form(self) -> str:
        """Its name."""
        return self.realization.form

    def esr(self, which: str, label: str = "training") -> float | None:
        """Pooled free-run ESR of one of `SHOWN` on "training" or "held-out" data; None where it diverges.

        Parameters
        ----------
        which : str
            One of `SHOWN`.
        label : {"training", "held-out"}
            Part of the data.

        Returns
        -------
        float or None
        """
        return {v.label: v.overall.free_run.esr for v in self.figures[which]}[label]

    def with_model(self, model: LPVStateSpace) -> FormRefit:
        """The same figures beside another model of this form, such as one fitted to all data.

        Parameters
        ----------
        model : LPVStateSpace
            To stand as the form re-estimated.

        Returns
        -------
        FormRefit
        """
        return replace(self, found=self.found.replace(model=model))

    def to_dict(self) -> dict:
        """Plain data for JSON.

        Returns
        -------
        dict
            Plain values by name.
        """
        return {"form": self.form, "gap": self.gap.to_dict(), "free_run": self.summary(),
                "remark": self.remark, "identification": self.found.to_dict()}

    def summary(self) -> dict:
        """Free-run figures by model and by part of the data.

        Returns
        -------
        dict
            Plain data for JSON: ``{model: {part: {"esr": …, "fit_percent": … [%]}}}``.
        """
        return {name: {v.label: {"esr": v.overall.free_run.esr, "fit_percent": v.overall.free_run.fit_percent}
                       for v in shown} for name, shown in self.figures.items()}

    def rows(self) -> list[tuple[str, ...]]:
        """Name, and free-run ESR on each part of the data, as text.

        Returns
        -------
        list of tuple of str
            One row per model; "diverges" for a run without figure.
        """
        def text(value: float | None) -> str:
            return "diverges" if value is None else f"{value:.4g}"

        return [(name, *(text(v.overall.free_run.esr) for v in shown)) for name, shown in self.figures.items()]

    def __str__(self) -> str:
        parts = [v.label for v in self.figures[SHOWN[0]]]
        lines = [f"The {self.form} form ({self.model.order} states), free-run ESR:",
                 f"  {'':<20}{''.join(f'{p:>12}' for p in parts)}"]
        lines += [f"  {row[0]:<20}{''.join(f'{cell:>12}' for cell in row[1:])}" for row in self.rows()]
        lines.append(f"  as realised {self.gap.advice}")
        lines += [f"  note: {n}" for n in self.found.notes if "Levenberg" in n or "stages" in n or "frozen pole" in n]
        lines += [f"  note: {self.remark}"] if self.remark else []
        return "\n".join(lines)

    __repr__ = __str__


def refit_form(realization: Realization | LPVTransferFunction, records: Record | Sequence[Record], *,
               form: str | None = None, held_out: Record | Sequence[Record] | None = None, stages: bool = True,
               iterations: int = 60, sample_rate: float | None = None) -> FormRefit:
    """Re-estimate the entries of a realised form by simulation error, with its figures beside the others.

    Parameters
    ----------
    realization : Realization or LPVTransferFunction
        What `realize` returned, or the transfer function with `form`.
    records, held_out : Record or sequence of Record
        Training data, and data that no fit uses.
    form : {"controllable", "observable"}, optional
        Needed with a transfer function only.
    stages : bool
        Whether the parameters of input stage and scheduling filter join the search.
    iterations : int
        Linearisations at most, in each of the two searches.
    sample_rate : float, optional
        As in `identify`.

    Returns
    -------
    FormRefit

    Raises
    ------
    InputError
        A form that equals its transfer function, several outputs, unusable data.

    Examples
    --------
    >>> import numpy as np
    >>> from lpvid.scheduling import Polynomial
    >>> from lpvid.simulation import simulate
    >>> rng, basis = np.random.default_rng(0), Polynomial("p", degree=1)
    >>> plant = LPVTransferFunction.siso([[-1.2, 0.3], [0.5, -0.2]], [[0, 0], [0.4, 0.1]], basis, 1.0)
    >>> signals = {"u1": rng.normal(size=800), "p": rng.uniform(-1, 1, 800)}
    >>> y = simulate(realize(plant, "controllable").model, Record(signals, sample_time=1.0), "zero").output[:, 0]
    >>> record = Record({**signals, "y1": y}, sample_time=1.0)
    >>> refit = refit_form(plant, record, form="controllable")
    >>> refit.esr("transfer function") > 0.1, refit.esr("form re-estimated") < 1e-9
    (True, True)
    """
    if isinstance(realization, LPVTransferFunction):
        if form is None:
            raise InputError("which form is to be re-estimated?", mend='give form="controllable" or "observable"')
        realization = realize(realization, form)
    elif not isinstance(realization, Realization):
        raise InputError("a form is re-estimated from a transfer function or a realisation",
                         got=type(realization).__name__, mend="of an identification, give its .model")
    elif form not in (None, realization.form):
        raise InputError("another form than the one realised", got=f"{form} and {realization.form}",
                         mend="leave form out, or give the transfer function")
    source = realization.source
    structure = CanonicalForm(source, realization.form, stages, iterations)
    found = identify(records, structure, held_out=held_out, sample_rate=sample_rate)
    models = dict(zip(SHOWN[:2], (source, realization.model), strict=True))
    data = {"training": records} | ({} if held_out is None else {"held-out": held_out})
    figures = {name: tuple(validate(model, part, label=label) for label, part in data.items())
               for name, model in models.items()}
    own = tuple(v for v in (found.training, found.held_out) if v is not None)
    figures[SHOWN[2]] = own
    listed = as_records(records)
    listed = with_derived(listed, structure.channels)
    pieces = segments(listed, structure.channels, sample_rate=1 / source.sample_time if sample_rate else None,
                      minimum=structure.start + 2)
    made = FormRefit(realization, found, realization.gap(pieces, "training"), figures)
    made = replace(made, remark=_remark(made, pieces))
    return made.with_model(found.model.replace(metadata={**found.model.metadata, "free_run": made.summary()}))


def _remark(refit: FormRefit, records: Sequence[Record]) -> str:
    """Why the form re-estimated may run worse than as realised, although its simulation error is the smaller one.

    The search takes the initial states that suit its free run best; the figures start from the first ``start`` samples,
    which determine a state that the output shows weakly only within the error of the model.
    """
    realised, own = (refit.esr(name) for name in SHOWN[1:])
    if realised is None or (own is not None and own - realised <= SAME):
        return ""
    left, total = 0.0, 0.0
    for record in records:
        run = simulate(refit.model, record, "estimate")
        y = record[refit.model.outputs[0].name]
        left, total = left + float(np.sum((run.output[:, 0] - y) ** 2)), total + float(np.sum((y - y.mean()) ** 2))
    ran = "it diverges too" if not np.isfinite(left) else f"free-run ESR, training {left / total:.4g}"
    return (f"re-estimated it runs worse than as realised, because the first {refit.model.start} samples of a record "
            f"do not determine its states; from states fitted to {FIT_SAMPLES} samples and more "
            f"(initial='estimate'): {ran}; otherwise use the form as realised (leave out --refit-form)")
