"""LPV embeddings E1-E9 of the nonlinear quarter car (equation sheet 4.3), and plants for the design of controllers.

Names load on first use.

>>> from quartercar import lpv_models
>>> lpv_models.SaturationPair.number
'E1'
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)  # names stand in __init__.pyi, once
