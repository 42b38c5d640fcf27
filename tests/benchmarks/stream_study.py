"""One Parquet file larger than memory: rate and peak memory of the streamed estimate beside those in memory.

    python tests/benchmarks/stream_study.py FOLDER [--samples 1e8] [--memory 1e7] [--time]

A fourth-order LPV system with 24 parameters (synthetic) is written to FOLDER, row group by row group, and removed
at the end. Expected, written down before the run: the streamed estimate, reading included, at no less than two thirds
of the in-memory rate of the same commit; below 1 GB at any length; equal to the in-memory estimate of the same
samples to 1e-10; a run that is killed goes on behind its last chunk.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

import lpvid as lpv
from lpvid.files.streaming import read_chunks
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Channel

STRUCTURE = lpv.ARX(na=4, nb=4, nk=1, input="u", output="y", basis=lpv.Polynomial(("p",), degree=2))
PART = 1_000_000
A = [[-1.8, 0.10, 0.02], [1.3, -0.1, 0.0], [-0.5, 0.05, 0.01], [0.08, 0, 0]]
B = [[0, 0, 0], [0.4, 0.1, 0.0], [0.1, -0.3, 0.05], [0.05, 0, 0], [0.02, 0.01, 0]]


def record_of(channels: Mapping[str, np.ndarray]) -> lpv.Record:
    """Pure numbers at 512 Hz."""
    return lpv.Record({name: Channel(values) for name, values in channels.items()}, sample_time=1 / 512)


def written(path: Path, samples: int, clock: bool) -> None:
    """A file of row groups of a million samples, one continuous record."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    rng = np.random.default_rng(3)
    model = LPVTransferFunction.siso(A, B, lpv.Polynomial(("p",), degree=2), 1 / 512)
    names = (["time [s]"] if clock else []) + ["u", "p", "y"]
    schema = pa.schema([(n, pa.float64()) for n in names], metadata={"sample_rate": "512"})
    past, before, done = np.zeros((4, 1)), {"u1": np.zeros(4), "p": np.zeros(4)}, 0
    with pq.ParquetWriter(path, schema, compression="snappy") as out:
        while done < samples:
            n = min(PART, samples - done)
            t = (done + np.arange(n)) / 512
            new = {"u1": rng.normal(size=n), "p": np.sin(0.7 * t) * np.sin(0.013 * t)}
            joined = {k: np.concatenate([before[k], new[k]]) for k in new}
            y = lpv.simulate(model, record_of(joined), past).output
            past, before = y[-4:], {k: v[-4:] for k, v in joined.items()}
            columns = {"time [s]": t, "u": new["u1"], "p": new["p"], "y": y[4:, 0] + 0.01 * rng.normal(size=n)}
            out.write_table(pa.table([columns[k] for k in names], schema=schema))
            done += n


def spent(function) -> tuple[float, float, object]:
    """Processor and wall time [s], and the result."""
    cpu, wall = time.process_time(), time.perf_counter()
    found = function()
    return time.process_time() - cpu, time.perf_counter() - wall, found


def in_memory(path: Path) -> tuple[float, np.ndarray]:
    """Samples per second of processor time, and the parameters."""
    records = lpv.read(path)
    STRUCTURE.estimate(records)
    cpu, wall, found = spent(lambda: STRUCTURE.estimate(records))
    rate = records[0].n_samples / cpu
    print(f"in memory, {records[0].n_samples:,} samples: {cpu:.2f} s of processor, {wall:.2f} s; "
          f"{rate / 1e6:.2f} million/s")
    return rate, found.parameters  # type: ignore[attr-defined]


def high_water() -> float:
    """Most resident memory of this program [MB]; `ru_maxrss` of a child begins with its parent's."""
    status = Path("/proc/self/status")
    if status.exists():
        return int(status.read_text().split("VmHWM:")[1].split()[0]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def child(path: Path, state: str, rows: int) -> None:
    """The streamed estimate in a process of its own, so that its peak memory is that of nothing else."""
    k = np.arange(99.0)
    lpv.identify_stream([record_of({"u": k % 2, "p": k, "y": k % 3})],
                        lpv.ARX(1, 1, 1, "u", "y", lpv.Polynomial(("p",), degree=1)))  # compiled before it counts
    next(iter(read_chunks(path, rows)))  # pyarrow loaded
    cpu, wall, found = spent(lambda: lpv.identify_stream(read_chunks(path, rows), STRUCTURE, checkpoint=state or None))
    peak = high_water()
    print(repr((cpu, wall, peak, found.n_samples, found.parameters.tolist())))  # type: ignore[attr-defined]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--samples", type=float, default=1e8)
    parser.add_argument("--memory", type=float, default=1e7)
    parser.add_argument("--rows", type=int, default=131_072)
    parser.add_argument("--time", action="store_true", help="a column of time stamps too")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child is not None:
        child(given.folder, given.child, given.rows)
        return
    given.folder.mkdir(parents=True, exist_ok=True)
    small, large = given.folder / "small.parquet", given.folder / "large.parquet"
    try:
        written(small, int(given.memory), given.time)
        rate, theta = in_memory(small)

        def streamed(path: Path, state: str = "", limit: float | None = None) -> tuple | None:
            words = [sys.executable, __file__, str(path), "--child", state, "--rows", str(given.rows)]
            try:
                done = subprocess.run(words, capture_output=True, text=True, check=True, timeout=limit)
            except subprocess.TimeoutExpired:
                return None
            return eval(done.stdout)

        found = streamed(small)
        assert found is not None
        apart = np.abs(np.array(found[4]) - theta).max() / np.abs(theta).max()
        print(f"streamed, the same: {found[0]:.1f} s of processor; in memory over streamed rate "
              f"{found[0] * rate / given.memory:.2f}; peak {found[2]:.0f} MB; parameters apart {apart:.1e} (relative)")
        state = str(given.folder / "state.npz")
        killed = streamed(small, state, limit=0.6 * found[1])
        again = streamed(small, state)
        assert again is not None
        same = np.abs(np.array(again[4]) - theta).max() / np.abs(theta).max()
        print(f"killed after {0.6 * found[1]:.0f} s ({'yes' if killed is None else 'no: it was done'}), then "
              f"{again[0]:.1f} s of processor for the rest; parameters apart {same:.1e}")
        small.unlink()
        written(large, int(given.samples), given.time)
        size = large.stat().st_size / 1e9
        found = streamed(large)
        assert found is not None
        slower = found[0] * rate / given.samples
        print(f"streamed, {given.samples:.0e} samples ({size:.1f} GB): {found[0]:.0f} s of processor, "
              f"{found[1]:.0f} s; in memory over streamed rate {slower:.2f}; peak {found[2]:.0f} MB; "
              f"{found[3]} equations")
    finally:
        for path in (small, large, given.folder / "state.npz"):
            path.unlink(missing_ok=True)


if __name__ == "__main__":
    main()
