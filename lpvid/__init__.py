"""lpvid: identification, analysis and control of linear parameter-varying systems.

>>> import lpvid as lpv
>>> lpv.Polynomial("current", degree=1).labels
('1', 'current')

Names load on first use, so that ``import lpvid`` stays quick.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)  # names stand in __init__.pyi, once
