"""Selection: which effects, one after the other or in linked pairs, the data call for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.effect import Effect
from lpvid.diagnosis.noise import Whitening
from lpvid.diagnosis.problem import Problem
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

SIGNIFICANT = 0.05
"""p-value of the largest block statistic"""
BIC_GAIN = 10.0
"""whitened BIC that a cause must win"""
SHORTLIST = 6
"""candidates refitted at every step"""
MOST_EFFECTS = 4
TASTE = 6
"""iterations of a first refit from each starting point"""
STARTS = 3


@dataclass
class Search:
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
    """

    problem: Problem
    fit: Refit
    candidates: tuple[Effect, ...]
    rng: np.random.Generator
    say: Callable[[str], None]
    p_values: dict[str, float] = field(default_factory=dict)

    @classmethod
    def begin(cls, problem: Problem, baseline_fit: Refit, candidates: tuple[Effect, ...], rng: np.random.Generator,
              say: Callable[[str], None]) -> tuple[Search, list[Evidence], list[Direction]]:
        """Whiten by what no candidate can explain, refit, and screen."""
        search = cls(problem, baseline_fit, candidates, rng, say)
        evidence, found = search.rewhiten()
        return search, evidence, found

    def rewhiten(self) -> tuple[list[Evidence], list[Direction]]:
        """Estimate the noise's colour anew around the present set, refit it, and screen the candidates outside it."""
        outside = self.outside()
        moved = moves(self.problem, self.fit, outside)
        left = saturated(self.problem, self.fit, moved)
        whitening = Whitening.of(left, self.problem.blocks.mask())
        self.problem = self.problem.with_whitening(whitening)
        self.fit = refit(self.problem, self.fit.composition, self.fit.vector)
        found = directions(self.problem, self.fit, moved)
        return screen(self.problem, self.fit, found, self.rng), found

    def outside(self) -> tuple[Effect, ...]:
        """Candidates that are not in the set."""
        names = {e.name for e in self.fit.composition.effects}
        return tuple(e for e in self.candidates if e.name not in names)

    # -- growing -----------------------------------------------------------------------------------------------------
    def grow(self, evidence: list[Evidence], found: list[Direction]) -> tuple[list[Evidence], list[Direction]]:
        """Add effects while one of them passes the block test and wins BIC; re-rank all after each."""
        while len(self.fit.composition.effects) < MOST_EFFECTS:
            least = min((e.p_value for e in evidence), default=1.0)
            best = self.best_addition(evidence, found) if least < SIGNIFICANT else None
            if best is None:
                best = self.best_pair(evidence, found)
            if best is None:
                break
            added, fit = best
            for e in added:
                self.p_values[e.name] = min((x.p_value for x in evidence if x.effect.name == e.name), default=least)
            self.fit = fit
            evidence, found = self.rewhiten()
            self.prune()
        return evidence, found

    def best_addition(self, evidence: Sequence[Evidence], found: Sequence[Direction]
                      ) -> tuple[tuple[Effect, ...], Refit] | None:
        """The single effect whose joint refit wins most, if it wins enough."""
        threshold = DETECT + np.log(self.problem.n_samples)
        listed = [e for e in evidence if e.best is not None and e.likelihood_ratio > 0.5 * threshold][:SHORTLIST]
        tried = []
        for e in listed:
            self.say(f"refitting with {e.effect.name}")
            tried.append((e.effect, self.with_effects((e.effect,), found)))
        tried = [(e, f) for e, f in tried if f.bic() < self.fit.bic() - BIC_GAIN and resolved(self.problem, f)]
        if not tried:
            return None
        effect, fit = min(tried, key=lambda t: t[1].bic())
        return (effect,), fit

    def best_pair(self, evidence: Sequence[Evidence], found: Sequence[Direction]
                  ) -> tuple[tuple[Effect, ...], Refit] | None:
        """A physically linked pair that wins where no single effect does."""
        if min((e.p_value for e in evidence), default=1.0) > 4 * SIGNIFICANT:
            return None
        names = {e.name: e for e in self.outside()}
        pairs = {tuple(sorted((e.name, p))) for e in names.values() for p in e.partners if p in names}
        best: tuple[tuple[Effect, ...], Refit] | None = None
        for a, b in sorted(pairs):
            self.say(f"refitting with {a} and {b} together")
            fit = self.with_effects((names[a], names[b]), found)
            if fit.bic() < self.fit.bic() - 3 * BIC_GAIN and (best is None or fit.bic() < best[1].bic()):
                best = ((names[a], names[b]), fit)
        return best

    def with_effects(self, added: Sequence[Effect], found: Sequence[Direction]) -> Refit:
        """The set with further effects, refitted jointly from the most promising grid points."""
        composition = Composition(self.fit.composition.baseline, (*self.fit.composition.effects, *added))
        points = [_starts(e, found) for e in added]
        starts = [dict(zip([e.name for e in added], (p[min(k, len(p) - 1)] for p in points), strict=True))
                  for k in range(max(len(p) for p in points))]
        if len(added) > 1:
            starts = [dict(zip([e.name for e in added], pair, strict=True))
                      for pair in [(a, b) for a in points[0] for b in points[-1]][:4]]
        tasted = [refit(self.problem, composition, placed(composition, self.fit, s), iterations=TASTE) for s in starts]
        return refit(self.problem, composition, min(tasted, key=lambda f: f.cost).vector)

    # -- shrinking and swapping ----------------------------------------------------------------------------------------
    def without(self, effect: Effect) -> Refit:
        """The set without one effect, refitted."""
        rest = tuple(e for e in self.fit.composition.effects if e.name != effect.name)
        composition = Composition(self.fit.composition.baseline, rest)
        return refit(self.problem, composition, placed(composition, self.fit, {}))

    def prune(self) -> None:
        """Drop effects that the others have made superfluous."""
        while len(self.fit.composition.effects) > 1:
            smaller = [(self.without(e), e) for e in self.fit.composition.effects]
            fit, effect = min(smaller, key=lambda t: t[0].bic())
            if fit.bic() - self.fit.bic() > BIC_GAIN:
                return
            self.say(f"{effect.name} is no longer needed")
            self.fit = fit


def resolved(problem: Problem, fit: Refit) -> bool:
    """Whether every strength is more than what the hold between samples can feign."""
    clock = problem.signals[0].sample_time
    return all(abs(fit.vector[p.start] - e.neutral[0]) >= e.resolution * clock
               for e, p in zip(fit.composition.effects, fit.composition.places, strict=True))


def _starts(effect: Effect, found: Sequence[Direction]) -> list[np.ndarray]:
    """The grid points that fit the present residual best; at least one."""
    mine = sorted((d for d in found if d.effect.name == effect.name and d.visible),
                  key=lambda d: d.gain, reverse=True)
    chosen: list[np.ndarray] = []
    for d in mine:
        if len(chosen) < STARTS and all(not np.allclose(d.values, c) for c in chosen):
            chosen.append(d.values)
    return chosen or [effect.neutral + np.array([p.grid[0] - p.neutral if k == 0 else 0.0
                                                 for k, p in enumerate(effect.parameters)])]
