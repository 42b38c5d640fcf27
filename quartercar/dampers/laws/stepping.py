"""Integration steps of compiled free runs, chosen by the motion."""

from __future__ import annotations

import numpy as np

from quartercar.dampers.drive import Drive
from quartercar.dampers.sizes import travel

TRAVEL = 1e-4
"""a² times the acceleration that an integration step of length a may have: what it travels about a reversal, as a share
of the root mean square of the displacement; a micrometre of a centimetre."""
FEWEST, MOST = 2, 20
"""integration steps per sample"""


def motion_steps(drive: Drive) -> np.ndarray:
    """(n − 1,) integration steps per sample, by the motion alone: the force stays smooth in the parameters.

    Slow sines at 200 Hz take two, a random motion up to 50 Hz at 500 Hz takes eight on average.

    Parameters
    ----------
    drive : Drive
        Its velocity [m/s], displacement [m] and period are read.

    Returns
    -------
    (n − 1,) array of int
        Between `FEWEST` and `MOST`.

    Examples
    --------
    >>> x = np.array([0.01, -0.01, 0.01])
    >>> motion_steps(Drive(0.005, np.array([0.0, 0.001, 0.02]), x, np.zeros(3))).tolist()
    [3, 11]
    """
    reach = travel([drive])
    if not reach:
        return np.full(max(drive.n_samples - 1, 0), FEWEST)
    wanted = np.sqrt(np.abs(np.diff(drive.velocity)) * drive.sample_time / (TRAVEL * reach))
    return np.clip(np.ceil(wanted), FEWEST, MOST).astype(int)
