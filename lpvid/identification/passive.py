"""Passive: the model of a structure that runs closest to the measured output among those that never give energy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid import _checks
from lpvid._threads import single_thread
from lpvid.analysis.passivity import certificate_of, certify_passivity, proven
from lpvid.analysis.passivity_certificate import PassivityCertificate
from lpvid.errors import InputError
from lpvid.identification.arx import ARX, ThroughARX
from lpvid.identification.layout import ParameterLayout
from lpvid.identification.output_error import OutputError
from lpvid.identification.passive_search import PassiveSearch, Reached
from lpvid.identification.pem_problem import PredictionErrorProblem
from lpvid.identification.result import COVARIANCE_LIMIT, Identification
from lpvid.identification.stage_fit import fitted_stages, shorten
from lpvid.identification.structure import Structure
from lpvid.lmi.passive_form import preload
from lpvid.model.input_stage import TanhStage
from lpvid.model.noise_model import NoiseModel
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record

SAMPLES = 20_000
"""Samples on which the search goes most of its way: several hundred per parameter. All data are used at the end."""
LAST_STEPS = 6
"""Steps on all data."""
TIGHTER = (10.0, 10.0, 10.0)
"""Factors by which the room kept in the inequality grows where the re-check does not hold."""


@dataclass(frozen=True)
class Passive(ThroughARX):
    """A structure of a damper (velocity in, force out) whose model must be passive.

    The unconstrained estimate comes first; its orders, basis and box are kept. Then

        minimise Σ (y(k) − ŷ(k))², ŷ in free run,   subject to   M(p, p⁺) ≻ 0 and P(p) ≻ 0 for all p, p⁺ in the box

    with the dissipation inequality M of `lpvid.lmi.passive_form`, over numerators, denominators, the knee of a tanh
    stage, the scheduling filter, the storage function P(p) and the sector multiplier λ(p) together. Affine terms become
    one constant preload, for a force at rest that follows the current does work when the current moves. The search
    starts from a static damper, which is passive, and every iterate is passive while the current moves arbitrarily
    fast; it is a local search. What it ends at is certified by numpy.

    Parameters
    ----------
    structure : ARX or OutputError
        One input, one output, nk = 0, coefficients at p(k), no stage or a tanh stage. For `ARX` too it is the free run
        that is minimised.
    degree : int
        Degree of P in the scheduling. One P for all of it costs little (ESR 0.0375 against 0.0371 with P affine in the
        current, on the rig) and a quarter of the time.
    balanced : bool
        Weigh each record's error by its own variance, so that records at low current, whose force is small, count as
        those at high current: the free-run ESR averaged over records is minimised, not that of all together.

    Examples
    --------
    >>> import numpy as np
    >>> from lpvid.identification import identify
    >>> rng = np.random.default_rng(0)
    >>> v, f = rng.normal(size=400), np.zeros(400)
    >>> for k in range(1, 400):
    ...     f[k] = 0.5 * f[k - 1] + v[k] + 0.2 * v[k - 1]
    >>> record = Record({"velocity": v, "force": f}, sample_time=0.01)
    >>> found = identify(record, Passive(ARX(na=1, nb=2, nk=0)))
    >>> found.model.frozen_poles([]).real.round(3), found.model.metadata["passive"]["verdict"]
    (array([0.5]), 'certified')
    """

    structure: ARX | OutputError
    degree: int = 0
    balanced: bool = False

    def __post_init__(self) -> None:
        inner = self.structure
        if not isinstance(inner, (ARX, OutputError)):
            raise InputError("no passive model of this structure", got=type(inner).__name__,
                             why="the constraint is stated of transfer functions fitted by their free run",
                             mend="use ARX or OutputError (--structure arx or oe)")
        arx = self.arx
        _checks.count(self.degree, "degree of the storage function")
        if len(arx.input) != 1 or len(arx.output) != 1:
            raise InputError("a passive model has one input and one output",
                             got=f"{len(arx.input)} inputs, {len(arx.output)} outputs",
                             mend="take the velocity as the only input")
        if arx.delay != (0,):
            raise InputError("a passive model has a direct term", got=f"nk = {arx.delay[0]}",
                             why="a force that does not answer within the sample can be made to give energy",
                             mend="set nk=0 (--nk 0)")
        if arx.lagged:
            raise InputError("a passive model takes its coefficients at p(k)", got="lagged=True",
                             mend="leave lagged (--lagged) out")
        if arx.stage is not None and arx.stage != "tanh" and not isinstance(arx.stage, TanhStage):
            raise InputError("the input stage of a passive model is tanh", got=str(arx.stage), mend="use --shape tanh")
        if arx.weight is not None:
            raise InputError("a passive model takes no weights", got=f"weight '{arx.weight}'", mend="leave weight out")

    summary = Structure.summary

    @property
    def arx(self) -> ARX:
        """The equation-error structure of the same orders."""
        return self.structure if isinstance(self.structure, ARX) else self.structure.arx

    def estimate(self, records: Sequence[Record]) -> Identification:
        _takes_energy(records, self.arx.input[0], self.arx.output[0])
        first = self.structure.estimate(records)
        with single_thread():
            return self._constrained(list(records), first)

    def _constrained(self, records: list[Record], first: Identification) -> Identification:
        sample = shorten(records, SAMPLES, self.start + 50)
        offset = _offset(first.model) if self.arx.affine else 0.0
        search = self._search(sample, first)
        reached = search.run(search.memoryless(first.model, offset))
        if sum(r.n_samples for r in sample) < sum(r.n_samples for r in records):
            search = self._search(records, first)
            reached = search.run(replace(reached, cost=search.cost(reached.xi)), LAST_STEPS)
        for factor in TIGHTER:
            certificate = self.certificate(search, reached)
            if certificate.verified:
                break
            search = replace(search, room=factor * search.room)
            reached = search.run(reached, LAST_STEPS, descend=False)
        return self._package(records, first, search, reached, self.certificate(search, reached))

    def _search(self, records: list[Record], first: Identification) -> PassiveSearch:
        arx = first.structure if isinstance(first.structure, ARX) else first.structure.arx
        free = (isinstance(self.arx.stage, str), isinstance(self.arx.schedule_filter, str))
        assert isinstance(first.layout, ParameterLayout)
        problem = PredictionErrorProblem(
            records, arx, first.model, first.layout, NoiseModel("output"), free, estimate_past=False
        )
        rms = [float(np.sqrt(np.mean(np.concatenate([r[n] for r in records]) ** 2)))
               for n in (*arx.input, *arx.output)]
        return PassiveSearch(problem, first.layout, *rms, offset=bool(arx.affine), degree=self.degree,
                             balanced=self.balanced)

    def certificate(self, search: PassiveSearch, reached: Reached) -> PassivityCertificate:
        """What numpy finds about the storage function that the search ended with; else a search of its own.

        Parameters
        ----------
        search : PassiveSearch
            That gave the model.
        reached : Reached
            Where it ended.

        Returns
        -------
        PassivityCertificate
        """
        units, model = (search.speed, search.force), search.model_at(reached.xi)
        program = search.program(reached.xi)
        storage, multiplier, outcome = proven(model, program, reached.iterate, units)
        if outcome.holds and outcome.between_grid:
            return certificate_of(model, storage, multiplier, outcome)
        return certify_passivity(model)

    def _package(self, records: list[Record], first: Identification, search: PassiveSearch, reached: Reached,
                 certificate: PassivityCertificate) -> Identification:
        layout = search.layout
        model = search.model_at(reached.xi)
        covariance, condition, rows, kind = search.covariance(reached)
        structure = replace(self, structure=replace(self.structure, basis=model.basis, stage=model.input_stage,
                                                    schedule_filter=model.scheduling_stage))
        kind += ", the constraint left out"
        metadata: dict = {"structure": structure.to_dict(), "covariance_kind": kind,
                          "training": {"records": [r.name for r in records], "n_samples": rows},
                          "passive": certificate.to_dict()}
        if layout.size <= COVARIANCE_LIMIT:
            metadata["parameters"] = {"layout": layout.to_list(), "covariance": covariance.tolist()}
        spread = search.plain_cost(reached.xi) / rows
        model = model.replace(noise=NoiseModel("output"), noise_covariance=np.array([[spread]]), metadata=metadata)
        aim = "free-run error of each record over its variance" if self.balanced else "free-run error"
        sector = "a" if certificate.multiplier.size else "no"
        notes = [f"passive: {reached.steps} steps from a static damper, {aim} minimised; storage function of degree "
                 f"{certificate.basis.degree} and {sector} multiplier of the input stage's sector"]
        stages = [f"fitted along with the passive model: {stated}" for stated in fitted_stages(model, self.arx)]
        return Identification(model, structure, layout, covariance, condition, condition, rows,
                              notes=(*stages, *notes), covariance_kind=kind,
                              unconstrained=first.model)

    def to_dict(self) -> dict:
        """Plain data for JSON.

        Returns
        -------
        dict
            Plain values by name.
        """
        return {**self.structure.to_dict(), "passive": True, "storage_degree": self.degree, "balanced": self.balanced}


def _takes_energy(records: Sequence[Record], velocity: str, force: str) -> None:
    """Refuse records whose force, its mean left out, gives energy on the whole: their polarity is reversed."""
    mean = float(np.mean(np.concatenate([r[force] for r in records])))
    work = sum(float((r[force] - mean) @ r[velocity]) for r in records)
    if work < 0:
        raise InputError("no passive model of records that give energy", got=f"the mean of {force} times {velocity} is "
                         "negative", why="passive means extension and tension positive; here one of them is reversed",
                         mend=f"turn a channel (--flip {force})")


def _offset(model: LPVTransferFunction) -> float:
    """The constant force at rest of the unconstrained model, at the middle of its box."""
    known = preload(model)
    if known is not None:
        return known
    a, _, c = model.coefficients(model.box.centre)
    return float(c.sum() / (1 + a[:, 0, 0].sum()))
