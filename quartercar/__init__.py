"""quartercar: dampers, roads, the car between them and a virtual test rig.

Names load on first use, so that ``import quartercar`` stays quick.

>>> import quartercar
>>> quartercar.dampers.model_class("linear").title
'Mass, viscous, spring'
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)  # names stand in __init__.pyi, once
