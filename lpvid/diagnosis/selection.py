"""Selection: which effects, one after the other or in linked pairs, the data call for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from lpvid._threads import in_parallel
from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.effect import Effect
from lpvid.diagnosis.noise import Whitening
from lpvid.diagnosis.problem import DiagnosisProblem, projector, without
from lpvid.diagnosis.racing import race
from lpvid.diagnosis.refitting import Refit, refit
from lpvid.diagnosis.screening import (
    DETECT,
    Direction,
    Evidence,
    directions,
    moves,
    placed,
    saturated,
    screen,
)
from lpvid.diagnosis.starting import STARTS, own_values, starts
from lpvid.diagnosis.steadiness import surely_there

SIGNIFICANT = 0.05
"""p-value of the largest block statistic"""
BIC_GAIN = 10.0
"""whitened BIC that a cause must win"""
SHORTLIST = 6
"""candidates refitted at every step"""
LARGEST = 3
"""of those that promise to change most in the output, refitted as well"""
REFINED = 0.03
"""share of what an effect wins that a special case of it may win less: so little may be the law's small print"""
LENIENT = 100.0
"""BIC that a plausible special case may lose to an implausible general one"""
MOST_EFFECTS = 4
WORTH = 0.3
"""share of the negligible contribution that a candidate must promise by proportion to be refitted"""
TASTE = 6
"""iterations of a first refit from each starting point"""
STUBBORN, PATIENCE = 0.1, 2
"""share of the promised log-likelihood below which a first refit goes on, and how many times it may"""
CRUDE = 0.03
"""squared error of the fitted baseline, relative to the output's, above which its parameters are not to be trusted as
a start"""
FOUND = 0.5
"""share of the squared error of a baseline that had given up at which the set is on its way without further starts"""
COMPONENT = 0.5
"""share of what a catch-all wins for which a component is taken before it"""
TRIED, ENOUGH = 3, 0.02
"""further starts tried for a candidate where they are not; share of the present cost at which one is good enough"""
GLANCES, GLANCE = 2, 2
"""further starts from which every point of a candidate is looked at, and iterations of such a look"""
SEEN = 0.9
"""share of the present cost below which such a look must come for the candidate to be listed"""
NEAR, NEAR_SHARE = 20.0, 0.2
"""BIC by which a first refit may trail the best one, flat and as a share of what that wins, to be followed further"""


@dataclass
class ForwardSelection:
    """A growing set of effects around one baseline, with the filter that whitens what is left.

    Attributes
    ----------
    problem : Problem
    fit : Refit
    candidates : tuple of Effect
    rng : Generator
    say : callable
        Told what is being done.
    p_values : dict
        Block p-value with which each effect came in.
    others : tuple of (P,) arrays
        Further starts for the baseline's parameters, where its fit is far off.
    given_up_at : float
        Squared error of that fit; the further starts are done with once the set leaves `FOUND` of it.
    bare : (P,) array
        The baseline's parameters as they were fitted first, without effects.
    rests, known : dict
        Refits under the present filter by the names of their effects, for the next round in which rivals are weighed:
        to the end, and those of rivals, which may have been left far behind.
    """

    problem: DiagnosisProblem
    fit: Refit
    candidates: tuple[Effect, ...]
    rng: np.random.Generator
    report_progress: Callable[[str], None]
    p_values: dict[str, float] = field(default_factory=dict)
    others: tuple[np.ndarray, ...] = ()
    given_up_at: float = 0.0
    bare: np.ndarray = field(default_factory=lambda: np.empty(0))
    rests: dict[frozenset[str], Refit] = field(default_factory=dict)
    known: dict[frozenset[str], Refit] = field(default_factory=dict)

    @classmethod
    def begin(
        cls,
        problem: DiagnosisProblem,
        baseline_fit: Refit,
        candidates: tuple[Effect, ...],
        rng: np.random.Generator,
        report_progress: Callable[[str], None],
    ) -> tuple[ForwardSelection, list[Evidence], list[Direction]]:
        """Whiten by what no candidate can explain, refit, and screen."""
        search = cls(problem, baseline_fit, candidates, rng, report_progress)
        if search.far_off():
            search.others = tuple(baseline_fit.composition.baseline.starts(problem.signals))
            search.given_up_at = search._squared(baseline_fit)
        evidence, found = search.rewhiten()
        search.bare = search.fit.vector
        return search, evidence, found

    def far_off(self, fit: Refit | None = None) -> bool:
        """Whether a fit, the present one, leaves so much that its parameters are not to be trusted as a start."""
        fit = fit or self.fit
        return self._squared(fit) > CRUDE * self.problem.n_samples * self.problem.spread**2

    def _squared(self, fit: Refit) -> float:
        """Squared error in the output's unit."""
        plain = self.problem.stack(self.problem.errors(fit.composition, fit.vector), whiten=False)
        return float(plain @ plain)

    def rewhiten(self) -> tuple[list[Evidence], list[Direction]]:
        """Estimate the noise's colour anew around the present set, refit it, and screen the candidates outside it."""
        outside = self.outside()
        moved = moves(self.problem, self.fit, outside)
        left = saturated(self.problem, self.fit, moved)
        whitening = Whitening.of(left, self.problem.blocks.mask())
        self.problem, self.rests, self.known = self.problem.with_whitening(whitening), {}, {}
        self.fit = refit(self.problem, self.fit.composition, self.fit.vector)
        found = directions(self.problem, self.fit, moved)
        return screen(self.problem, self.fit, found, self.rng), found

    def outside(self) -> tuple[Effect, ...]:
        """Candidates that are not in the set, nor special cases of one that is."""
        names = {name for e in self.fit.composition.effects
                 for name in (e.name, *(c for c in e.contains if c not in e.beside))}
        return tuple(e for e in self.candidates if e.name not in names)

    def enlarged(self, added: Sequence[Effect]) -> Composition:
        """The set with further effects, which take the place of their special cases."""
        gone = {name for e in added for name in e.contains}
        kept = [e for e in self.fit.composition.effects if e.name not in gone]
        return Composition(self.fit.composition.baseline, (*kept, *added))

    # -- growing -----------------------------------------------------------------------------------------------------
    def grow(self, evidence: list[Evidence], found: list[Direction], avoid: str = ""
             ) -> tuple[list[Evidence], list[Direction]]:
        """Add effects while one of them passes the block test and wins BIC; re-rank all after each.

        The effect to be avoided is not the first to be added. Where the set comes back to what it was, each that it
        takes in making another superfluous, there is no more to be found.
        """
        evidence = [e for e in evidence if e.effect.name != avoid]
        faint_before = led = False
        been: set[frozenset[str]] = set()
        while len(self.fit.composition.effects) < MOST_EFFECTS:
            if self.fit.composition.members in been:
                break
            been.add(self.fit.composition.members)
            least = min((e.p_value for e in evidence), default=1.0)
            best = self.best_addition(evidence, found) if least < SIGNIFICANT else None
            faint = best is not None and self.negligible(*best)
            if best is None or faint:
                stood, pair = self.fit, self.best_pair(evidence, found)
                if pair is None and self.fit is not stood and not led:  # a pair has led the set itself on
                    led = True
                    been.discard(self.fit.composition.members)
                    evidence, found = self.rewhiten()
                    continue
                best = pair or best
            if best is None:
                break
            added, fit = best
            for e in added:
                self.p_values[e.name] = min((x.p_value for x in evidence if x.effect.name == e.name), default=least)
            self.fit = fit
            if self.others and (not self.far_off() or self._squared(self.fit) < FOUND * self.given_up_at):
                self.others = ()
            self.simplify()
            self.put_beside()
            if faint and len(added) == 1:
                size = len(fit.composition.effects)
                self.prune()
                kept = len(self.fit.composition.effects) == size  # it takes no other's place: enough
                if kept and (faint_before or added[0].stage != "measurement"):
                    break
                faint_before = True  # the chain's small print may show most sharply, and hide what is larger
            evidence, found = self.rewhiten()
            self.prune()
        return evidence, found

    def best_addition(self, evidence: Sequence[Evidence], found: Sequence[Direction]
                      ) -> tuple[tuple[Effect, ...], Refit] | None:
        """The single effect whose joint refit wins most, if it wins enough."""
        threshold = DETECT + np.log(self.problem.n_samples)
        listed = [e for e in evidence if e.best is not None and e.likelihood_ratio > 0.5 * threshold]
        worth = {e.effect.name: self.worth(e.effect, found) for e in listed}
        weighty = [e for e in listed if worth[e.effect.name] > WORTH * e.effect.negligible * self.problem.spread]
        largest = sorted(weighty, key=lambda e: -worth[e.effect.name])[:LARGEST]
        listed = [e for k, e in enumerate(weighty) if k < SHORTLIST or e in largest] or listed[:1]
        self.report_progress(f"screening {', '.join(e.effect.name for e in listed)}")
        fits = in_parallel(lambda e: self.taste((e.effect,), found), listed)
        if self.others and all(self.far_off(f) for f in fits):
            afar = [e for e in self.seen_afar(evidence) if e not in listed]
            fits += in_parallel(lambda e: self.taste((e.effect,), found), afar)
            listed += afar
        most = max((self.won(f) for f in fits), default=0.0)
        promised = [e.likelihood_ratio if e.likelihood_ratio > most else 0.0 for e in listed]
        fits = in_parallel(lambda t: self.pursued(*t), list(zip(fits, promised, strict=True)))
        clock = self.problem.signals[0].sample_time
        tasted = [(e.effect, f) for e, f in zip(listed, fits, strict=True)
                  if not e.effect.unresolved(own_values(f, e.effect), clock)]
        least = min((f.bic() for _, f in tasted), default=0.0)
        near = least + NEAR + NEAR_SHARE * max(self.fit.bic() - least, 0.0)
        followed = [e for e, f in tasted if f.bic() <= near]
        special = {name for e in followed for name in e.contains}
        chosen = [(e, f) for e, f in tasted if e in followed or e.name in special]
        self.report_progress(f"refitting with {', '.join(e.name for e, _ in chosen)}")
        fits = in_parallel(lambda t: refit(self.problem, t[1].composition, t[1].vector, near=self.fit, rough=True),
                           chosen)
        tried = [(e, f) for (e, _), f in zip(chosen, fits, strict=True)]
        tried = [(e, f) for e, f in tried if f.bic() < self.fit.bic() - BIC_GAIN]
        tried = [(e, f) for e, f in tried if surely_there(self.problem, f, e)]
        if not tried:
            return None
        tried = [(e, f) for e, f in tried if not self.negligible((e,), f)] or tried
        effect, fit = min(tried, key=self._rank)
        if effect.catch_all:  # a component that wins a good part of it comes first: the form may then be superfluous
            wanted = self.fit.bic() - COMPONENT * (self.fit.bic() - fit.bic())
            components = [(e, f) for e, f in tried if not e.catch_all and f.bic() < wanted
                          and not e.implausible(own_values(f, e))]
            effect, fit = min(components, key=self._rank, default=(effect, fit))
        for special, other in tried:  # what one number fewer explains as well is the better name
            allowed = max(BIC_GAIN, REFINED * (self.fit.bic() - fit.bic()))
            if special.name in effect.contains and other.bic() < fit.bic() + allowed:
                effect, fit = special, other
        return (effect,), fit

    @staticmethod
    def _rank(tried: tuple[Effect, Refit]) -> tuple[bool, float]:
        effect, fit = tried
        return bool(effect.implausible(own_values(fit, effect))), fit.bic()

    def worth(self, effect: Effect, found: Sequence[Direction]) -> float:
        """What an effect may change in the output, by proportion and with room: root mean square, in its unit."""
        return max((d.worth for d in found if d.effect is effect), default=0.0)

    def negligible(self, added: Sequence[Effect], fit: Refit) -> bool:
        """Whether what a refit adds to the simulation is too small to be worth naming."""
        change = [fit.composition.predict(s, fit.vector) - self.fit.composition.predict(s, self.fit.vector)
                  for s in self.problem.signals]
        size = float(np.sqrt(np.mean(self.problem.stack(change, whiten=False) ** 2)))
        return size < max(e.negligible for e in added) * self.problem.spread

    def best_pair(self, evidence: Sequence[Evidence], found: Sequence[Direction]
                  ) -> tuple[tuple[Effect, ...], Refit] | None:
        """A physically linked pair that wins where no single effect does.

        Against the present set from where the pair has led it: a way out of a valley is nothing that it explains.
        """
        if min((e.p_value for e in evidence), default=1.0) > 4 * SIGNIFICANT:
            return None
        names = {e.name: e for e in self.outside()}
        pairs = {tuple(sorted((e.name, p))) for e in names.values() for p in e.partners if p in names}
        best: tuple[tuple[Effect, ...], Refit] | None = None
        listed = [(names[a], names[b]) for a, b in sorted(pairs) if self.promising((names[a], names[b]), found)]
        for a, b in listed:
            self.report_progress(f"screening {a.name} and {b.name} together")
        for (a, b), fit in zip(listed, in_parallel(lambda pair: self.taste(pair, found), listed), strict=True):
            if fit.bic() < self.fit.bic() - 3 * BIC_GAIN and (best is None or fit.bic() < best[1].bic()):
                best = ((a, b), fit)
        if best is None:
            return None
        self.report_progress(f"refitting with {' and '.join(e.name for e in best[0])} together")
        fit = refit(self.problem, best[1].composition, best[1].vector, near=self.fit)
        alone = refit(self.problem, self.fit.composition, placed(self.fit.composition, fit, {}), near=fit)
        if alone.bic() < self.fit.bic() - BIC_GAIN:
            self.fit = alone
        won = fit.bic() < self.fit.bic() - 3 * BIC_GAIN and not self.negligible(best[0], fit)
        return (best[0], fit) if won and all(surely_there(self.problem, fit, e) for e in best[0]) else None

    def promising(self, pair: tuple[Effect, Effect], found: Sequence[Direction]) -> bool:
        """Whether both together, each at its best grid points, lie along what is left: a look before a costly refit.

        Least squares of the residual on the joint change and each one's own, all beyond the present sensitivities.
        """
        composition = Composition(self.fit.composition.baseline, (*self.fit.composition.effects, *pair))
        residual = self.fit.errors
        best = largest = 0.0
        for a in starts(pair[0], found)[:2]:
            for b in starts(pair[1], found)[:2]:
                moved = _moved(self.problem, self.fit, composition, {pair[0].name: a, pair[1].name: b})
                together = self.problem.stack(moved)
                alone = [d.change for e, v in zip(pair, (a, b), strict=True) for d in found
                         if d.effect.name == e.name and np.array_equal(d.values, v)]
                columns = without(projector(self.fit.jacobian), np.column_stack([together, *alone]))
                weights = np.linalg.lstsq(columns, residual, rcond=1e-8)[0]
                size = float(np.sqrt(np.mean(self.problem.stack(moved, whiten=False) ** 2)))
                best = max(best, float(residual @ columns @ weights))
                largest = max(largest, abs(weights[0]) * size)
        worth = WORTH * max(e.negligible for e in pair) * self.problem.spread
        return best > self.fit.variance * (DETECT + np.log(self.problem.n_samples)) and largest > worth

    def won(self, fit: Refit) -> float:
        """Log-likelihood by which another fit does better than the present one."""
        return (self.fit.cost - fit.cost) / self.fit.variance

    def pursued(self, fit: Refit, promised: float) -> Refit:
        """A first refit carried on where it keeps little of what was promised to first order: the way may be bent."""
        for _ in range(PATIENCE if promised else 0):
            if self.won(fit) >= STUBBORN * promised:
                break
            fit = refit(self.problem, fit.composition, fit.vector, iterations=2 * TASTE, rough=True)
        return fit

    def taste(self, added: Sequence[Effect], found: Sequence[Direction]) -> Refit:
        """The set with further effects after a few rough steps from the most promising grid points."""
        composition = self.enlarged(added)
        points = [starts(e, found) for e in added]
        names = [e.name for e in added]
        pairs = [(p,) for p in points[0]] if len(added) == 1 else [(a, b) for a in points[0] for b in points[-1]][:3]
        begun = [placed(composition, self.fit, dict(zip(names, p, strict=True))) for p in pairs]
        best = race(self.problem, composition, [(start, self.fit) for start in begun])
        if len(added) > 1 or not self.others:
            return best
        for look in self.from_afar(added[0])[:TRIED]:
            if best.cost < ENOUGH * self.fit.cost:
                break
            other = refit(self.problem, composition, look.vector, rough=True)
            best = min((best, other), key=lambda f: f.cost)
        return best

    def from_afar(self, effect: Effect) -> list[Refit]:
        """A few steps from every point of a candidate and further starts of the baseline, best first.

        A baseline that was fitted to motion far out of step has given up, and nothing beside it seems to help.
        """
        def look() -> list[Refit]:
            composition, found = self.enlarged((effect,)), []
            for values in effect.points(self.problem.signals):
                for other in self.others[:GLANCES]:
                    start = placed(composition, self.fit, {effect.name: values})
                    start[: other.size] = other
                    found.append(refit(self.problem, composition, start, iterations=GLANCE, rough=True))
            return sorted(found, key=lambda f: f.cost)

        return self.fit.cached(("from afar", effect.name), look)

    def seen_afar(self, evidence: Sequence[Evidence]) -> list[Evidence]:
        """Those that do best from afar."""
        looks = in_parallel(lambda e: min((f.cost for f in self.from_afar(e.effect)[:1]), default=np.inf), evidence)
        near = sorted(zip(looks, range(len(evidence)), strict=True))[:LARGEST]
        return [evidence[k] for cost, k in near if cost < SEEN * self.fit.cost]

    # -- shrinking and swapping ----------------------------------------------------------------------------------------
    def without(self, *effects: Effect) -> Refit:
        """The set without some of its effects, refitted."""
        gone = {e.name for e in effects}
        rest = tuple(e for e in self.fit.composition.effects if e.name not in gone)
        composition = Composition(self.fit.composition.baseline, rest)
        if composition.members not in self.rests:
            self.rests[composition.members] = self.refitted(composition, rough=True)
        return self.rests[composition.members]

    def refitted(self, composition: Composition, rough: bool = False) -> Refit:
        """A part of the set, from where it stands or with the baseline as it was first fitted, whichever is nearer.

        An effect that takes the place of much of the baseline leaves its parameters far from where they go without it.
        """
        begun = [placed(composition, self.fit, {}) for _ in range(2)]
        begun[1][: self.bare.size] = self.bare
        errors = [self.problem.stack(self.problem.errors(composition, v)) for v in begun]
        start = begun[int(np.argmin([float(e @ e) for e in errors]))]
        return refit(self.problem, composition, start, near=self.fit if rough else None, rough=rough)

    def simplify(self) -> None:
        """Put special cases in the place of effects that do no better than they, or only beyond what is plausible."""
        for e in self.fit.composition.effects:
            have = {x.name for x in self.fit.composition.effects}
            cases = [c for c in self.candidates if c.name in e.contains and c.name not in have]
            won = self.without(e).bic() - self.fit.bic() if cases else 0.0
            for special in cases:
                rest = tuple(x for x in self.fit.composition.effects if x is not e)
                composition = Composition(self.fit.composition.baseline, (*rest, special))
                fit = race(self.problem, composition, [(placed(composition, self.fit, {special.name: v}), self.fit)
                                                       for v in special.points(self.problem.signals)[:STARTS]])
                fit = refit(self.problem, composition, fit.vector, near=self.fit, rough=True)
                allowed = max(BIC_GAIN, REFINED * won)
                if e.implausible(own_values(self.fit, e)) and not special.implausible(own_values(fit, special)):
                    allowed += LENIENT
                if fit.bic() < self.fit.bic() + allowed:
                    self.report_progress(f"{special.name} does as well as {e.name}")
                    self.p_values[special.name] = self.p_values.get(e.name, 1.0)
                    self.fit = fit
                    return self.simplify()
        return None

    def put_beside(self) -> None:
        """Add the special cases that may act beside an effect of the set, which may have grown to do their work."""
        for e in self.fit.composition.effects:
            have = {x.name for x in self.fit.composition.effects}
            for special in [c for c in self.candidates if c.name in e.beside and c.name not in have]:
                composition = Composition(self.fit.composition.baseline, (*self.fit.composition.effects, special))
                first = special.points(self.problem.signals)[0]
                begun = [placed(composition, self.fit, {e.name: v, special.name: first})
                         for v in e.points(self.problem.signals)]
                tasted = in_parallel(lambda v, c=composition: refit(self.problem, c, v, iterations=TASTE, near=self.fit,
                                                                    rough=True), begun)
                fit = min(tasted, key=lambda f: f.cost)
                fit = refit(self.problem, composition, fit.vector, near=self.fit, rough=True)
                if fit.bic() < self.fit.bic() - BIC_GAIN and not self.negligible((special,), fit):
                    self.report_progress(f"{special.name} beside {e.name}")
                    self.p_values[special.name] = self.p_values.get(e.name, 1.0)
                    self.fit = fit

    def prune(self) -> None:
        """Drop effects that the others have made superfluous."""
        while len(self.fit.composition.effects) > 1:
            effects = self.fit.composition.effects
            smaller = list(zip(in_parallel(self.without, effects), effects, strict=True))
            fit, effect = min(smaller, key=lambda t: t[0].bic())
            if fit.bic() - self.fit.bic() > BIC_GAIN:
                return
            self.report_progress(f"{effect.name} is no longer needed")
            self.fit = fit


def _moved(
    problem: DiagnosisProblem, fit: Refit, composition: Composition, given: dict[str, np.ndarray]
) -> list[np.ndarray]:
    """Per record, (n,) change of the simulation when effects are put beside a fit."""
    vector = placed(composition, fit, given)
    with np.errstate(all="ignore"):
        return [np.nan_to_num(composition.predict(s, vector) - fit.composition.predict(s, fit.vector), nan=0.0,
                              posinf=0.0, neginf=0.0) for s in problem.signals]
