"""Public names and where they live; `lazy_loader` reads this file at import, type checkers as well."""

from . import controllers as controllers
from . import criteria as criteria
from . import dampers as dampers
from . import effects as effects
from . import lpv_models as lpv_models
from . import parameters as parameters
from . import plot as plot
from . import rig as rig
from . import roads as roads
from .characterisation import characterise as characterise
from .dampers.fitting import fit as fit
from .parameters import CarParameters as CarParameters
from .rides.simulation import ride as ride
from .vehicle.nonlinear import QuarterCar as QuarterCar
