"""Public names and where they live; `lazy_loader` reads this file at import, type checkers as well."""

from .admissible import AdmissibleForce as AdmissibleForce
from .embedding import Embedding as Embedding
from .embedding import replay as replay
from .frozen_damper import FrozenDamper as FrozenDamper
from .identified import IdentifiedDamper as IdentifiedDamper
from .identified_continuous import ContinuousDamper as ContinuousDamper
from .identified_ramp import RampedDamper as RampedDamper
from .limited_pair import LimitedPair as LimitedPair
from .nominal_force import LimitedForce as LimitedForce
from .nominal_force import NominalForce as NominalForce
from .prefilter import Prefiltered as Prefiltered
from .prefilter import prefiltered as prefiltered
from .region import Region as Region
from .saturation_pair import SaturationPair as SaturationPair
from .speed_scheduled import SpeedScheduled as SpeedScheduled
from .strip import pair_box as pair_box
from .strip import pair_hull as pair_hull
from .variable_damping import VariableDamping as VariableDamping
from .yielding import Reach as Reach
from .yielding import YieldingLaw as YieldingLaw
