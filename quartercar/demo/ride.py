"""The last step of the demo: a controller for the car with the model that it identified, verified and driven."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from lpvid.codec import Encoded
from lpvid.report import Section

if TYPE_CHECKING:
    from lpvid.model.transfer_function import LPVTransferFunction
    from quartercar.design.identified import IdentifiedDesign
    from quartercar.rides.comparison import RideComparison

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
        """For the terminal."""
        return [self.design.verdict, *str(self.rides).splitlines()[:14]]

    def section(self) -> Section:
        """For the report."""
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


def design_and_ride(model: LPVTransferFunction, seed: int = 0,
                    report_progress: Callable[[str], None] = lambda text: None) -> DemoRide:
    """Design an LPV controller with the identified damper's dynamics in the plant, and drive it over two roads.

    Parameters
    ----------
    model : LPVTransferFunction
        As identified: the car's damper, and that of the plant.
    seed : int
        Of roads and noise.
    say : callable
        Told what is being done.
    """
    from quartercar.controllers import law_class
    from quartercar.controllers.designed.lpv_hinf_identified import LpvHinfIdentified
    from quartercar.dampers.blackbox.identified import Identified
    from quartercar.design.identified import IdentifiedDesign
    from quartercar.design.nominal import design
    from quartercar.parameters import MEGANE
    from quartercar.rides.comparison import compare_rides
    from quartercar.roads.ride_roads import Bump, IsoRoad
    from quartercar.vehicle.damper_from_file import current_limits
    from quartercar.vehicle.nonlinear import BumpStops, Coil, QuarterCar

    damper = Identified.of(model, "the model of the demo")
    low, high = current_limits(damper, 2.5)
    car = QuarterCar(MEGANE, damper, BumpStops(), Coil(lowest=low, highest=high))
    report_progress("designing a controller for the identified plant")
    found = design(car, LpvHinfIdentified())
    assert isinstance(found, IdentifiedDesign)
    laws = {name: law_class(name)() for name in ("passive", "skyhook-linear", "sh-add")}
    if found.synthesis.solved:
        laws["lpv-hinf-identified"] = found.controller
    rides = compare_rides(
        car, (IsoRoad("C", RATE, DURATION), Bump()), laws, range(seed, seed + SEEDS), report_progress=report_progress
    )
    return DemoRide(found, rides)
