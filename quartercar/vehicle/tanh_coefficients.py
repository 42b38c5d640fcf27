"""Dampers that a compiled car can step: laws of one form, with coefficients by the current."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from quartercar.dampers.contract import Damper

Form = Callable[[np.ndarray], np.ndarray]
"""(n,) currents -> (n, 8) of F = a_0 + a_1 v + a_2 x + a_3 tanh(a_4 v + a_5 x + a_6 tanh(x/a_7))."""


def tanh_form(damper: Damper | None) -> Form | None:
    """The coefficients of a law by the current; None for a damper that is not of this form.

    Parameters
    ----------
    damper : Damper or None
        None gives None.

    Returns
    -------
    Form or None
        From (n,) currents to (n, 8) coefficients, the force at rest included.
    """
    return None if damper is None else damper.tanh_form()
