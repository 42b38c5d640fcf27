"""`lpvid fleet`: many files on many processes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lpvid.cli import options
from lpvid.cli.running import SHORTFALL, Results, command, conclude, working
from lpvid.errors import InputError

if TYPE_CHECKING:
    from lpvid.cli.structures import Request
    from lpvid.fleet import FleetResult
    from lpvid.identification.arx import ARX


@command
def fleet(
    data: options.Data,
    do: Annotated[str, typer.Option("--do", metavar="STEP[,STEP]", help="audit, identify (one model of all files, and "
                                    "the files that differ from it), diagnose (those files).")] = "audit,identify",
    input: options.Inputs = None,
    output: options.Outputs = None,
    schedule: options.Schedule = None,
    na: Annotated[int, typer.Option("--na", min=0, help="Output lags of the common model.")] = 2,
    nb: Annotated[str, typer.Option("--nb", metavar="N[,N…]", help="Its input lags.")] = "2",
    nk: Annotated[str, typer.Option("--nk", metavar="N[,N…]", help="Its first input lag.")] = "0",
    degree: Annotated[int, typer.Option("--degree", min=0, help="Degree in the scheduling variables.")] = 1,
    role: options.Role = None,
    baseline: Annotated[str | None, typer.Option("--baseline", metavar="LAW|FILE", help="Law that diagnose starts "
                                                 "from; left out, the one that suits healthy files "
                                                 "best.")] = None,
    fdr: Annotated[float, typer.Option("--fdr", help="Expected share of files named wrongly among those "
                                     "named as different.")] = 0.05,
    scheduler: Annotated[str | None, typer.Option("--scheduler", metavar="ADDRESS", help="A running Dask scheduler, "
                                                  "e.g. tcp://10.0.0.1:8786; left out, a cluster on this "
                                                  "machine.")] = None,
    workers: Annotated[int | None, typer.Option("--workers", min=1, help="Processes of the local cluster (one per "
                                                "core, no more than files).")] = None,
    time_limit: Annotated[float, typer.Option("--time-limit", metavar="SECONDS", help="Time after which a step of a "
                                              "file is stopped and its later ones skipped.")] = 600.0,
    retries: Annotated[int, typer.Option("--retries", min=0, help="Further attempts at a step whose "
                                         "process died.")] = 2,
    out: options.Out = None,
    json: options.Json = False,
) -> None:
    """Audit, identify and diagnose many files; writes fleet.json, fleet.csv, report.html and a folder for each file.

    A file that fails or hangs is reported; the others go on. The folder is the state: run again, and only what is
    missing there is done. Needs the extra scale (Dask).
    """
    from lpvid.cli.data import parse_roles, split_names
    from lpvid.fleet import plan_fleet, run_fleet
    from lpvid.report.fleet import fleet_page

    if out is None:
        raise InputError("a fleet needs a folder, which is its state", got="no --out", mend="--out DIR")
    results = Results(out, "fleet.json", "fleet.csv", "report.html")
    structure = _structure(split_names(input), split_names(output), split_names(schedule), na, nb, nk, degree)
    plan = plan_fleet(data, out, do=split_names([do]), structure=structure, roles=parse_roles(role), baseline=baseline,
                      fdr=fdr, limit=time_limit, retries=retries)
    with working("starting the cluster") as report_progress:
        found = run_fleet(plan, scheduler=scheduler, workers=workers, report_progress=report_progress)
        results.json("fleet.json", found.to_dict())
        results.bytes("fleet.csv", _table(found).encode("utf-8"))
        results.report(fleet_page(found))
    conclude(results, found.to_dict(), str(found), json)
    if found.failed:
        raise typer.Exit(SHORTFALL)


def _structure(inputs: tuple[str, ...], outputs: tuple[str, ...], schedule: tuple[str, ...], na: int, nb: str, nk: str,
               degree: int) -> ARX:
    from lpvid.cli.data import numbers
    from lpvid.identification.arx import ARX
    from lpvid.scheduling import Polynomial

    basis = Polynomial(schedule, degree=degree) if schedule else Polynomial()
    return ARX(na, numbers(nb, "--nb"), numbers(nk, "--nk"), inputs or ("velocity",), outputs or ("force",), basis,
               affine=1)


def _table(found: FleetResult) -> str:
    """fleet.csv: a line for each file; its errors are those of the free run of the model of all, on training data."""
    import csv
    import io

    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["name", "file", "free_run_esr_training", "free_run_rmse_training",
                   "free_run_mean_error_training", "unit", "score", "q", "differs", "causes",
                   "probabilities", "rivals", "steps"])
    for row in found.to_dict()["files"]:
        stated = row["diagnosis"] or {"causes": [], "rivals": []}
        likely = [c["probability"] for c in stated["causes"]]
        rows.writerow([row["name"], row["file"], *(row.get(k) for k in ("esr", "rmse", "mean_error", "unit", "score",
                                                                        "q")), row["differs"], " ".join(row["causes"]),
                       " ".join("" if p is None else f"{p:.3f}" for p in likely),
                       " ".join("|".join(r) for r in stated["rivals"]),
                       " ".join(f"{s}:{o['state']}" for s, o in row["steps"].items())])
    return text.getvalue()


def identify_fleet(request: Request, data: Sequence[str], roles: Sequence[str] | None, refused: Mapping[str, Any],
                   scheduler: str | None, results: Results, report_progress: Callable[[str], None]) -> FleetResult:
    """`lpvid identify --fleet`: one model of all files, from the R factors of each, on a Dask cluster.

    Parameters
    ----------
    request : Request
        With the structure arx; a first input lag that was not given is chosen on the first file.
    data, roles : sequences of str
        As on the command line.
    refused : mapping
        Options that need all records in one process, by name; those that were given are refused.
    scheduler : str or None
        Address; None for a cluster on this machine.
    results : Results
        Its folder keeps the state in fleet/.
    report_progress : callable
        Receives progress.

    Returns
    -------
    FleetResult

    Raises
    ------
    InputError
        Such an option, another structure, no folder.
    """
    from lpvid.cli.data import parse_roles, read_records
    from lpvid.cli.modelling import _settled
    from lpvid.files import find
    from lpvid.fleet import plan_fleet, run_fleet
    from lpvid.identification.arx import ARX
    from lpvid.report.fleet import fleet_page

    for name, given in refused.items():
        if given:
            raise InputError(f"{name} needs all records in one process", why="--fleet reads them in many",
                             mend=f"leave {name} out, or leave --fleet out")
    if results.folder is None:
        raise InputError("a fleet needs a folder, which is its state", got="no --out", mend="--out DIR")
    structure = request.arx(request.delay)
    if request.searches_delay:
        first = read_records([str(find(list(data))[0])], roles=roles)
        settled = _settled(request, first, report_progress)[0]
        structure = settled if isinstance(settled, ARX) else structure
    if request.structure != "arx" or "passive" in request.given or structure.fits_stages:
        raise InputError("--fleet identifies arx, stages given or none", got=f"--structure {request.structure}",
                         why="only least squares adds up from file to file", mend="leave --fleet out")
    plan = plan_fleet(data, results.folder / "fleet", do=("identify",), structure=structure, roles=parse_roles(roles))
    found = run_fleet(plan, scheduler=scheduler, report_progress=report_progress)
    if found.found is None:
        raise InputError("no file could be used", got=next(iter(found.left_out.values()), ""))
    model = found.found
    results.save("model.json", model.model)
    results.json("identification.json", {**model.to_dict(), "model": "model.json"})
    results.json("fleet.json", found.to_dict())
    results.report(fleet_page(found))
    return found
