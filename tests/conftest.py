"""Fixtures shared by all tests."""

from __future__ import annotations

import base64
import functools
import gc
import itertools
import os

os.environ.setdefault("LPVID_PROGRESS", "quiet")  # a slow machine must not add lines to an error
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # small matrices: threads cost more than they bring
    os.environ.setdefault(_variable, "1")
os.environ.setdefault("MPLBACKEND", "agg")  # an example that shows its figure opens no window

from collections.abc import Callable, Generator, Iterable, Iterator  # noqa: E402
from contextlib import AbstractContextManager, contextmanager  # noqa: E402
from pathlib import Path  # noqa: E402
from types import SimpleNamespace  # noqa: E402
from typing import TYPE_CHECKING  # noqa: E402

import numpy as np  # noqa: E402
import pytest  # noqa: E402
from _pytest.doctest import DoctestModule  # noqa: E402
from hypothesis import settings  # noqa: E402

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lpvid.plot.style import Drawn

settings.register_profile("steady", derandomize=True, deadline=None)
settings.load_profile("steady")


TESTS = Path(__file__).parent

collect_ignore_glob = ["helpers/*", "benchmarks/[!t]*", "benchmarks/thesis_study.py"]
"""modules without a test or a doctest: their imports would only lengthen the collection"""


GENERATIONS = (20_000, 20, 20)
"""objects and rounds after which the garbage collector looks through a generation; Python's (700, 10, 10) cost a sixth
of the processor time of light tests (13.9 s for 11.7 s, `tests/contracts/test_estimators.py`, scheduling, model)"""


def pytest_configure(config: pytest.Config) -> None:
    """Collect garbage less often: the thousands of tests themselves are most of what it would look through."""
    gc.set_threshold(*GENERATIONS)
    _share_processors()
    _build_commands_once()
    config.pluginmanager.register(_OfExamplesOnly())
    if _is_from_the_end(config):
        config.pluginmanager.register(_FromTheEnd())


def _is_from_the_end(config: pytest.Config) -> bool:
    """Whether this is every second worker of a run over all tests: it imports the test modules from the last on."""
    worker = getattr(config, "workerinput", {}).get("workerid", "gw0")
    return int(worker[2:]) % 2 == 1 and config.args_source is pytest.Config.ArgsSource.TESTPATHS


def _files_reversed(nodes: Iterable[pytest.Item | pytest.Collector]) -> list:
    """The last file or folder first, what is of one in its own order."""
    files = [list(same) for _, same in itertools.groupby(nodes, key=lambda node: node.path)]
    return [node for same in reversed(files) for node in same]


class _Backwards(pytest.Dir):
    """A folder, collected from its end."""

    def collect(self) -> list:
        return _files_reversed(super().collect())


class _FromTheEnd:
    """Collect tests from the last file on: what one worker has rewritten for its assertions, the other then loads.

    Rewriting all of them takes 14 s of processor time, as long as all else of the collection.
    """

    @pytest.hookimpl(tryfirst=True)
    def pytest_collect_directory(self, path: Path, parent: pytest.Collector) -> pytest.Collector | None:
        inside = path == TESTS or TESTS in path.parents
        return _Backwards.from_parent(parent, path=path) if inside else None

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Workers have their tests in one order."""
        ours = [item for item in items if TESTS in item.path.parents]
        items[:] = _files_reversed(ours) + [item for item in items if TESTS not in item.path.parents]


class _OfExamplesOnly:
    """Modules without an example are neither imported nor searched for one: a third of a collection."""

    @pytest.hookimpl(wrapper=True)
    def pytest_collect_file(self, file_path: Path) -> Generator[None, list, list]:
        found = yield
        if file_path.suffix == ".py" and b">>> " not in file_path.read_bytes():
            return [node for node in found if not isinstance(node, DoctestModule)]
        return found


def _build_commands_once() -> None:
    """Typer builds every command of an app anew for each call through its runner: 0.03 to 0.1 s of hundreds of calls.

    The program itself is started once and builds them once.
    """
    import typer.testing

    typer.testing._get_command = functools.cache(typer.testing._get_command)


def _share_processors() -> None:
    """The processors are for all of pytest's workers: what one tests shares its work among its part of them.

    Otherwise every worker forks for as many as there are, which brings nothing where all are at work. Tests of forks,
    threads and processes state how many there are.
    """
    from lpvid import _threads

    part = max(_threads.processors() // int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1")), 1)
    _threads.processors = lambda: part


def pytest_collection_finish(session: pytest.Session) -> None:
    """What is collected stays to the end."""
    gc.freeze()


LONG_PAGES = ("docs/dampers.md", "docs/diagnosis.md", "docs/fixed_structure.md", "docs/howto/current_lags.md",
              "docs/howto/sample_rate.md", "docs/performance.md", "docs/plants.md", "docs/ride.md",
              "docs/robustness.md", "docs/synthesis.md")
"""pages whose examples fit and design for seconds what the tests of the same rooms do too: marked ``seconds``"""


NO_CASE = SimpleNamespace(marks=())
"""of a test without parameters"""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Of a test with the marker ``thinned(n)`` the first case and every n-th run by default, of ``seconds`` none.

    The others are ``slow``, or what the marker says in its second place; the third is a marker of the first ones. A
    case that is marked ``slow`` itself is not of ``seconds``, whatever its function is.
    """
    seen: dict[str, int] = {}
    for item in items:
        if item.nodeid.split("::")[0] in LONG_PAGES:
            item.add_marker(pytest.mark.seconds)
        mark = item.get_closest_marker("thinned")
        if mark is not None:
            name = item.nodeid.split("[")[0]
            n, rest, kept = (*mark.args, *("slow", None)[len(mark.args) - 1:])
            marker = rest if seen.setdefault(name, 0) % n else kept
            if marker:
                item.add_marker(marker)
            seen[name] += 1
        if any(case.name == "slow" for case in getattr(item, "callspec", NO_CASE).marks):
            item.own_markers[:] = [m for m in item.own_markers if m.name != "seconds"]
        if item.get_closest_marker("seconds") is not None:
            item.add_marker(pytest.mark.slow)


def _shared_data() -> Path | None:
    named = os.environ.get("LPVID_DATA")
    if named:
        return Path(named) if Path(named).is_dir() else None
    for parent in Path(__file__).resolve().parents:
        candidate = parent / "shared" / "data"
        if candidate.is_dir():
            return candidate
    return None


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of real measurements, or skip: they are not part of the project."""
    folder = _shared_data()
    if folder is None:
        pytest.skip("the real measurements are not here (set LPVID_DATA)")
    return folder


@pytest.fixture
def rng() -> np.random.Generator:
    """A generator with a fixed seed."""
    return np.random.default_rng(20260101)


ONE_PIXEL = base64.b64decode("iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGP4DwABAQEAsTj2"
                             "FAAAAABJRU5ErkJggg==")
"""a PNG of one pixel"""


@contextmanager
def _undrawn() -> Iterator[None]:
    import lpvid.plot
    import lpvid.plot.export
    from lpvid.plot.style import figure_of

    def frame(figure: Figure | Drawn) -> bytes:
        width, height = 72 * figure_of(figure).get_size_inches()
        return f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}pt" height="{height:g}pt"/>'.encode("ascii")

    with pytest.MonkeyPatch.context() as patch:
        for module in (lpvid.plot, lpvid.plot.export):
            patch.setattr(module, "svg", frame)
            patch.setattr(module, "png", lambda figure: ONE_PIXEL)
        yield


@pytest.fixture(scope="module")
def undrawn() -> Iterator[None]:
    """Reports and pictures with their figures made but not drawn: half of what a command takes that writes them.

    For modules about the answers of commands. The look of reports is tested where they are drawn: `test_report*.py`.
    """
    with _undrawn():
        yield


@pytest.fixture(scope="session")
def without_drawing() -> Callable[[], AbstractContextManager[None]]:
    """What `undrawn` does for a module, for a block: beside tests of the same module that look at the drawings."""
    return _undrawn
