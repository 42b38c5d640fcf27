"""`quartercar ride`: control laws on the same roads."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lpvid.cli import options
from lpvid.cli.running import SHORTFALL, Results, command, conclude, solver_output_suppressed, working
from lpvid.errors import InputError, NumericalError
from quartercar.cli import car_options

if TYPE_CHECKING:
    from quartercar.rides.bound import Bound
    from quartercar.rides.comparison import RideComparison
    from quartercar.rides.config import RideConfig
    from quartercar.rides.tuning import Tuned
    from quartercar.vehicle.nonlinear import QuarterCar

@command
def ride(
    config: car_options.Config = None,
    car: car_options.Car = None,
    damper: car_options.DamperFile = None,
    road: Annotated[list[str] | None, typer.Option("--road", metavar="ROAD", help="iso-c@20, bump@8, sweep, or a file "
                                                   "with its speed, roads.csv@10 [m/s], where it has several tracks "
                                                   "roads.csv#TRACK@10; repeat, or with commas.")] = None,
    controller: Annotated[list[str] | None, typer.Option("--controller", metavar="LAW", help="A law by name or a "
                                                         "controller.json; repeat, or with commas.")] = None,
    measurements: car_options.Measurements = None,
    seeds: Annotated[int | None, typer.Option("--seeds", min=1, help="Number of random roads, each "
                                              "with its own sensor noise.")] = None,
    tune: Annotated[int | None, typer.Option("--tune", min=0, metavar="N", help="Tune every law first, with N "
                                             "evaluations each, on other seeds.")] = None,
    preview: Annotated[str | None, typer.Option("--preview", metavar="AHEAD", help="The car as a rear axle: "
                                                "wheelbase=2.7 [m] or time=0.1 [s], with ,front=known for the profile "
                                                "itself or ,sensors=SET for the front axle; none: no preview.")] = None,
    bound: Annotated[bool | None, typer.Option("--bound/--no-bound", help="Also the clairvoyant bound: the best "
                                               "current for the known road, and each law as a share of it.",
                                               show_default=False)] = None,
    bound_seeds: Annotated[int | None, typer.Option("--bound-seeds", min=1, metavar="N", help="Number of seeds for "
                                                    "which the bound is computed (2).")] = None,
    template: car_options.Template = False,
    out: options.Out = None,
    json: options.Json = False,
) -> None:
    """Control laws of a semi-active damper on the same roads: comfort, road holding, stroke, energy.

    The nonlinear car with its identified damper, sensors with noise, an observer, the inverse of the damper model down
    to the coil's current. Writes ride.json, a file for each law, report.html and its figures.
    """
    from quartercar.rides.comparison import compare_rides
    from quartercar.rides.config import ride_template

    if template:
        typer.echo(ride_template(), nl=False)
        return
    results = Results(out, "ride.json", "report.html")
    with working("reading") as report_progress:
        chosen = _chosen(config, car, damper, road, controller, measurements, seeds, tune, preview)
        chosen = chosen.with_changes(bound=bound, bound_seeds=bound_seeds)
        _check(chosen)
        try:
            with solver_output_suppressed():
                laws, tuned = _tuned(chosen, report_progress)
                found = compare_rides(
                    chosen.car, chosen.roads, laws, chosen.seeds, chosen.settings, report_progress=report_progress
                )
                bounds = _bounds(chosen, found, report_progress)
        except NumericalError as error:
            data = {"schema": "quartercar/ride/1", "verdict": f"No comparison: {error}", "rides": []}
            results.json("ride.json", data)
            conclude(results, data, str(data["verdict"]), json)
            raise typer.Exit(SHORTFALL) from None
        data = {**found.to_dict(), **_setting(chosen), "tuned": {n: t.to_dict() for n, t in tuned.items()}}
        if chosen.bound:
            data["bounds"] = [b.to_dict() for b in bounds]
        _deliver(results, data, found, chosen, tuned, bounds, report_progress)
    conclude(results, data, "\n".join(map(str, (found, _loop(chosen), *bounds))), json)


def _loop(chosen: RideConfig) -> str:
    """Damper, limits of the command with their unit, rate of the loop."""
    car = chosen.car
    damper = "a viscous damper" if car.damper is None else f"damper {car.damper.name}"
    limits = f"command {_command(car)}" if _follows_command(car) else "which follows no command"
    ahead = "" if chosen.settings.preview is None else f", preview: {chosen.settings.preview}"
    return f"with {damper}, {limits}, loop at {1 / chosen.settings.period(car):.6g} Hz{ahead}"


def _chosen(config: Path | None, car: str | None, damper: Path | None, road: list[str] | None,
            controller: list[str] | None, measurements: str | None, seeds: int | None,
            tune: int | None, preview: str | None) -> RideConfig:
    """The configuration with the options put in."""
    from lpvid.cli.data import split_names
    from quartercar.rides.config import RideConfig, build_car, given_laws, load_config, measuring, roads_from_texts

    base = None if config is None else load_config(config, car, damper)
    base = base or RideConfig(build_car(car or "megane", None if damper is None else str(damper)))
    chosen = base.with_changes(
        roads=None if not road else roads_from_texts(road),
        controllers=None if not controller else given_laws(split_names(controller)),
        settings=None if measurements is None else measuring(measurements),
        seeds=None if seeds is None else tuple(range(base.seeds[0], base.seeds[0] + seeds)), tune=tune)
    return chosen if preview is None else _with_preview(chosen, preview, config is None and not controller)


def _with_preview(chosen: RideConfig, text: str, free: bool) -> RideConfig:
    """With the road ahead; where no laws are requested, also those that make use of it."""
    from dataclasses import replace

    from quartercar.rides.config import given_laws, laws_with_preview
    from quartercar.rides.preview import preview_from_text

    found = preview_from_text(text)
    laws = given_laws(laws_with_preview(chosen.car)) if free and found is not None else None
    return chosen.with_changes(settings=replace(chosen.settings, preview=found), controllers=laws)


def _tuned(chosen: RideConfig, report_progress: Callable[[str], None]) -> tuple[dict, dict[str, Tuned]]:
    """The laws, tuned where that was requested."""
    from quartercar.rides.tuning import Trial, tune_all

    if not chosen.tune:
        return dict(chosen.controllers), {}
    seeds = tuple(range(chosen.tune_seed, chosen.tune_seed + 3))
    clash = set(seeds) & set(chosen.seeds)
    if clash:
        raise InputError("tuning and comparison share a seed", got=str(min(clash)), mend="another tune_seed")
    report_progress("tuning")
    trial = Trial(chosen.car, chosen.roads, seeds, chosen.settings)
    tuned = tune_all(chosen.controllers, trial, max(chosen.tune, 4), report_progress)
    return {n: t.controller for n, t in tuned.items()}, tuned


def _check(chosen: RideConfig) -> None:
    """Refuse what cannot be had before anything is computed: a bound, too long a preview, or a road without a speed."""
    if chosen.bound:
        from quartercar.vehicle.adjoint import refuse_without_gradient

        refuse_without_gradient(chosen.car.damper)
    if chosen.settings.preview is not None:
        for road in chosen.roads:
            chosen.settings.preview.delay(road)


def _bounds(chosen: RideConfig, found: RideComparison, report_progress: Callable[[str], None]) -> tuple[Bound, ...]:
    """What the damper could have reached, where that was requested."""
    if not chosen.bound:
        return ()
    from quartercar.rides.bound import BoundSettings, bound_rides

    return bound_rides(
        chosen.car, chosen.roads, found, chosen.settings, BoundSettings(chosen.bound_seeds), report_progress
    )


def _setting(chosen: RideConfig) -> dict:
    from dataclasses import asdict

    sensors = chosen.settings.chain.sensors
    damper = chosen.car.damper
    unit = "A" if damper is None else damper.current_unit
    return {"car": asdict(chosen.car.parameters), "damper": None if damper is None else damper.name,
            "coil": {**asdict(chosen.car.coil), "unit": unit}, "sample_time": chosen.settings.period(chosen.car),
            "measurements": {"name": sensors.name, "sensors": [asdict(s) for s in sensors.sensors]},
            "roads": [r.to_dict() for r in chosen.roads],
            "preview": None if chosen.settings.preview is None else chosen.settings.preview.to_dict()}


def _follows_command(car: QuarterCar) -> bool:
    """Whether the damper's force depends on the command."""
    return car.damper is not None and "current" in car.damper.reads


def _command(car: QuarterCar) -> str:
    """Limits of the coil with their unit."""
    unit = "A" if car.damper is None else car.damper.current_unit
    return f"{car.coil.lowest:g} to {car.coil.highest:g} {'of 1' if unit == '1' else unit}"


def _deliver(results: Results, data: dict, found: RideComparison, chosen: RideConfig, tuned: dict[str, Tuned],
             bounds: tuple[Bound, ...], report_progress: Callable[[str], None]) -> None:
    """Queue ride.json, the laws, the figures and the report."""
    if not results.kept:
        return
    from quartercar.report.rides import ride_figures, ride_page

    report_progress("drawing")
    results.json("ride.json", data)
    for row in found.on(found.roads[0]):
        results.save(f"{row.name}.json", row.controller)
    figures = ride_figures(found, bounds)
    results.figures(figures)
    car = chosen.car
    facts = [("car", (car.parameters.source or "given").split(",")[0]),
             ("damper", "viscous" if car.damper is None else car.damper.title),
             ("command", _command(car) if _follows_command(car) else "none: the force does not depend on it"),
             ("sensors", chosen.settings.chain.sensors.name),
             ("loop", f"{1 / chosen.settings.period(car):.6g} Hz"), ("preview", str(chosen.settings.preview or "none"))]
    results.report(ride_page(found, figures, tuned, facts, bounds))
