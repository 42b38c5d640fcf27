"""Problem: records and their blocks, of which every statistic of a diagnosis is computed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from gc import collect

import numpy as np

from lpvid._memory import give_back
from lpvid._tall import move_together
from lpvid.baselines.baseline import Baseline
from lpvid.baselines.signals import Signals, in_turn
from lpvid.diagnosis.blocks import Blocks
from lpvid.effects.composition import Composition
from lpvid.record import Record
from lpvid.rounding import EXPLODED
from lpvid.validation.whitening import Whitening


@dataclass(frozen=True, eq=False)
class DiagnosisProblem:
    """Signals and blocks.

    Attributes
    ----------
    signals : tuple of Signals
    blocks : Blocks
    whitening : Whitening, optional
        Weights of the errors, where repeats give the spectrum of the noise. `errors` and `stack` have none; stacked
        errors, refits and what is computed of these are weighed.
    """

    signals: tuple[Signals, ...]
    blocks: Blocks
    whitening: Whitening | None = None

    @cached_property
    def block(self) -> np.ndarray:
        """(N,) block of every stacked sample."""
        return np.concatenate([n[n >= 0] for n in self.blocks.number])

    @property
    def n_samples(self) -> int:
        """Samples inside blocks."""
        return self.block.size

    @cached_property
    def spread(self) -> float:
        """Root mean square of the output about its mean, over the blocks."""
        inside = [s.output[n >= 0] for s, n in zip(self.signals, self.blocks.number, strict=True)]
        return float(np.concatenate(inside).std())

    def forget_simulations(self, collected: bool = False) -> None:
        """Drop what is cached along the signals.

        Parameters
        ----------
        collected : bool
            Whether garbage is collected at once: what is cached along signals refers to these.
        """
        for s in self.signals:
            s.cache.clear()
        if collected:
            collect()
            give_back()

    def errors(self, composition: Composition, vector: np.ndarray) -> list[np.ndarray]:
        """Per record, (n,) measured less simulated output; `EXPLODED` where that is larger or not finite.

        Parameters
        ----------
        composition : Composition
        vector : (P,) array

        Returns
        -------
        list of (n,) arrays
            All samples of the records, in the output's unit.
        """
        out = []
        for s in self.signals:
            with np.errstate(all="ignore"):
                e = s.output - composition.predict(s, vector)
            out.append(np.where(np.abs(e) < EXPLODED, e, EXPLODED))
        return out

    def stacked_errors(self, composition: Composition, vector: np.ndarray) -> np.ndarray:
        """Measured less simulated output inside the blocks, one record after the other, weighed.

        Parameters
        ----------
        composition : Composition
        vector : (P,) array

        Returns
        -------
        (N,) array
            In the output's unit.
        """
        return self.weighed(self.stack(self.errors(composition, vector)))

    def weighed(self, stacked: np.ndarray) -> np.ndarray:
        """Stacked values as they count: with the weights of the whitening.

        Parameters
        ----------
        stacked : (N,) or (N, k) array

        Returns
        -------
        (N,) or (N, k) array
        """
        return stacked if self.whitening is None else self.whitening.weighed(stacked)

    def unweighed(self, stacked: np.ndarray) -> np.ndarray:
        """Stacked values as they were before they were weighed.

        Parameters
        ----------
        stacked : (N,) or (N, k) array

        Returns
        -------
        (N,) or (N, k) array
        """
        return stacked if self.whitening is None else self.whitening.unweighed(stacked)

    def stack(self, values: Iterable[np.ndarray], overwriting: bool = False) -> np.ndarray:
        """(N,) or (N, k): per-record values inside the blocks, one record after the other.

        Parameters
        ----------
        values : iterable of (n,) or (n, k) arrays
            One for each record, taken one at a time.
        overwriting : bool
            Whether the values of a single record may be moved together where they are, so that no second array of
            their size is needed.

        Returns
        -------
        (N,) or (N, k) array
        """
        out, first = np.empty(0), 0
        for k, (v, n) in enumerate(zip(values, self.blocks.number, strict=True)):
            keep = n >= 0
            if overwriting and len(self.blocks.number) == 1 and v.flags.c_contiguous:
                return move_together(v, keep)
            if not k:
                out = np.empty((self.n_samples, *v.shape[1:]), dtype=v.dtype)
            last = first + int(np.count_nonzero(keep))
            np.compress(keep, v, axis=0, out=out[first:last])
            first = last
        return out

    def block_sums(self, stacked: np.ndarray) -> np.ndarray:
        """(blocks,) or (blocks, k) sums of stacked values.

        Parameters
        ----------
        stacked : (N,) or (N, k) array

        Returns
        -------
        (blocks,) or (blocks, k) array
            In the unit of the values.
        """
        out = np.zeros((self.blocks.count, *stacked.shape[1:]))
        np.add.at(out, self.block, stacked)
        return out

    def in_fold(self, fold: int) -> np.ndarray:
        """(N,) bool: stacked samples of a fold.

        Parameters
        ----------
        fold : {0, 1}

        Returns
        -------
        (N,) bool array
        """
        return self.blocks.fold[self.block] == fold


def problem_of(records: Sequence[Record], baseline: Baseline) -> DiagnosisProblem:
    """The problem of diagnosing a baseline along records.

    Parameters
    ----------
    records : sequence of Record
        Uniform, one rate; all of their samples are used.
    baseline : Baseline

    Returns
    -------
    DiagnosisProblem
    """
    signals = in_turn([baseline.signals(r) for r in records])
    return DiagnosisProblem(signals, Blocks.of(signals, baseline.start))
