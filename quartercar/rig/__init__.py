"""Virtual test rig: a physical damper with current, sensors and noise, and causes that can be switched on by name."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)  # names stand in __init__.pyi, once
