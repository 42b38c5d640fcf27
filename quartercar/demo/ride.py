"""The last step of the demo: a controller for the car with the model that it identified, verified and driven."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from lpvid.codec import Encoded
from lpvid.report import Section

if TYPE_CHECKING:
    from lpvid.model.transfer_function import LPVTransferFunction
    from quartercar.controllers.contract import Controller
    from quartercar.design.identified import IdentifiedDesign
    from quartercar.rides.comparison import RideComparison
    from quartercar.vehicle.nonlinear import QuarterCar

RATE = 20.0
"""speed on the rough road [m/s]"""
DURATION = 8.0
"""of the rough road [s]"""
SEEDS = 4
"""roads and noises"""


@dataclass(frozen=True, eq=False)
class DemoRide(Encoded):
    """A design, and the rides of its controller beside other laws.

    Attributes
    ----------
    design : IdentifiedDesign
    rides : RideComparison
    """

    JSON = ("design", ("ride", "rides"))

    design: IdentifiedDesign
    rides: RideComparison

    @property
    def verdict(self) -> str:
        """Two sentences."""
        return f"{self.design.verdict} {self.rides.verdict}"

    def lines(self) -> list[str]:
        """For the terminal.

        Returns
        -------
        list of str
            The verdict of the design and the first 14 lines of the comparison.
        """
        return [self.design.verdict, *str(self.rides).splitlines()[:14]]

    def section(self) -> Section:
        """For the report.

        Returns
        -------
        Section
            With both verdicts, the trade-offs, and signals and figures of every road.
        """
        from lpvid.report import Item, Paragraph
        from quartercar.report.rides import ride_figures, ride_page

        items: list[Item] = [
            Paragraph(self.design.verdict, strong=True),
            Paragraph("A nonlinear quarter car with the identified damper, its coil, noisy stroke and acceleration "
                      "sensors, an observer and the inverse damper model; laws with their default parameters, not "
                      "tuned. Tuning and more seeds: quartercar ride --tune."),
            Paragraph(self.rides.verdict)]
        for section in ride_page(self.rides, ride_figures(self.rides)).sections[: 1 + len(self.rides.roads)]:
            items += [Paragraph(f"{section.title}.", strong=True), *section.items]
        return Section("A controller, and its ride", tuple(items))


def demo_car(model: LPVTransferFunction) -> QuarterCar:
    """The Mégane's corner with the identified damper, its bump stops and its coil.

    Parameters
    ----------
    model : LPVTransferFunction
        Of the damper.

    Returns
    -------
    QuarterCar
    """
    from quartercar.dampers.blackbox.identified import Identified
    from quartercar.parameters import MEGANE
    from quartercar.vehicle.damper_from_file import current_limits
    from quartercar.vehicle.nonlinear import BumpStops, Coil, QuarterCar

    damper = Identified.of(model, "the model of the demo")
    low, high = current_limits(damper, 2.5)
    return QuarterCar(MEGANE, damper, BumpStops(), Coil(lowest=low, highest=high))


def ride_known(model: LPVTransferFunction, seed: int) -> RideComparison:
    """Drive the laws that need no design over two roads.

    Parameters
    ----------
    model : LPVTransferFunction
        The car's damper.
    seed : int
        First seed of roads and noise.

    Returns
    -------
    RideComparison
    """
    from quartercar.controllers import law_class

    return _driven(demo_car(model), {n: law_class(n)() for n in ("passive", "skyhook-linear", "sh-add")}, seed)


def design_and_ride(job: tuple[LPVTransferFunction, int]) -> tuple[IdentifiedDesign, RideComparison | None]:
    """Design an LPV controller with the identified damper's dynamics in the plant, and drive it over the same roads.

    Parameters
    ----------
    job : (LPVTransferFunction, int)
        The model as identified, the car's damper and that of the plant; the seed of roads and noise.

    Returns
    -------
    (IdentifiedDesign, RideComparison or None)
        None where no controller was found.
    """
    from quartercar.controllers.designed.lpv_hinf_identified import LpvHinfIdentified
    from quartercar.design.identified import IdentifiedDesign
    from quartercar.design.nominal import design

    model, seed = job
    car = demo_car(model)
    found = design(car, LpvHinfIdentified())
    assert isinstance(found, IdentifiedDesign)
    return found, _driven(car, {"lpv-hinf-identified": found.controller}, seed) if found.synthesis.solved else None


def _driven(car: QuarterCar, laws: Mapping[str, Controller], seed: int) -> RideComparison:
    from quartercar.rides.comparison import compare_rides
    from quartercar.roads.ride_roads import Bump, IsoRoad

    return compare_rides(car, (IsoRoad("C", RATE, DURATION), Bump()), laws, range(seed, seed + SEEDS))
