"""Plants of published design examples that are hard for a solver, with their sources."""

import numpy as np

import lpvid as lpv
from helpers.synthesis_plants import plant
from lpvid.synthesis.generalized_plant import GeneralizedPlant


def _first_order(gain: float, zero: float, pole: float) -> tuple[float, float, float]:
    """(pole, residue, direct) of gain·(s + zero)/(s + pole) = direct + residue/(s + pole)."""
    return pole, gain * (zero - pole), gain


def two_disks(criterion: str = "gain") -> GeneralizedPlant:
    """Two coupled spinning disks over the squares of their speeds, with weights.

    F. Wu, Control of Linear Parameter Varying Systems, Ph.D. thesis, Berkeley 1995; the weights are those of two
    examples of LPVTools (Hjartarson, Seiler & Packard 2015): "Modeling and Control of a LFT-based LPV System"
    (criterion "gain": scaled small gain 1.3361) and "Control Design for Stochastic LPV Systems" ("h2": 1.5998).
    """
    m1, m2, k, b = 1.0, 0.5, 200.0, 1.0
    wn = _first_order(100.0, 0.4, 40000.0)
    if criterion == "gain":
        we, wu = _first_order(0.3, 4.0, 0.04), _first_order(100.0, 0.1, 12500.0)
    else:
        we, wu = (0.04, 2.0, 0.0), None
    n = 8 if wu is not None else 7                                # disks 4, actuator, We, Wn, and Wu last
    a, b1, b2 = np.zeros((3, n, n)), np.zeros((3, n, 4)), np.zeros((3, n, 1))
    c1, d11, d12 = np.zeros((3, 3, n)), np.zeros((3, 3, 4)), np.zeros((3, 3, 1))
    c2, d21 = np.zeros((3, 2, n)), np.zeros((3, 2, 4))
    a[0, 0, 2] = a[0, 1, 3] = 1.0
    a[0, 2, :3] = -k / m1, -k / m1, -b / m1
    a[0, 3, :2], a[0, 3, 3] = (-k / m2, -k / m2), -b / m2
    a[1, 2, 0] = a[2, 3, 1] = 1.0                                 # rho1, rho2
    a[0, 2, 4], b1[0, 2, 1], b1[0, 3, 2] = 1 / m1, 0.1 / m1, 0.1 / m2
    a[0, 4, 4], b2[0, 4, 0] = -100.0, 100.0                       # actuator 1/(0.01 s + 1)
    a[0, 5, 5], a[0, 5, 1], b1[0, 5, 0] = -we[0], 1.0, -1.0       # We of r2 - ref
    c1[0, 2, 5], c1[0, 2, 1], d11[0, 2, 0] = we[1], we[2], -we[2]
    a[0, 6, 6], b1[0, 6, 3] = -wn[0], 1.0                         # Wn of the noise
    c2[0, 1, 1], c2[0, 1, 6], d21[0, 1, 3], d21[0, 0, 0] = 1.0, wn[1], wn[2], 1.0
    c1[0, 1, 4] = 1e-5                                            # Wa of the actuator's force
    if wu is None:
        d12[0, 0, 0] = 1 / 50
    else:
        a[0, 7, 7], b2[0, 7, 0], c1[0, 0, 7], d12[0, 0, 0] = -wu[0], 1.0, wu[1], wu[2]
    box = lpv.Scheduling(("rho1", "rho2"), (0.0, 0.0), (9.0, 25.0))
    return plant(a, b1, b2, c1, d11, d12, c2, d21, lpv.Polynomial(("rho1", "rho2"), 1), box)


def quarter_car(length: float = 1.0, force: float = 1.0) -> GeneralizedPlant:
    """A quarter car over its spring's stiffness and damping, in units of `length` [m] and `force` [N].

    Road, sensor noise and all performance signals are normalised, so that the units change no gain w -> z.
    """
    ms, mu, ks, kt, c = 315.0, 37.5, 29500.0, 208000.0, 1500.0
    a = np.zeros((3, 4, 4))                                       # deflection, body, tyre, wheel
    a[0] = [[0, 1, 0, -1], [-ks / ms, -c / ms, 0, c / ms], [0, 0, 0, 1], [ks / mu, c / mu, -kt / mu, -c / mu]]
    a[1, 1, 0], a[1, 3, 0] = -0.3 * ks / ms, 0.3 * ks / mu
    a[2, 1, 1], a[2, 1, 3], a[2, 3, 1], a[2, 3, 3] = -0.6 * c / ms, 0.6 * c / ms, 0.6 * c / mu, -0.6 * c / mu
    b1, b2 = np.zeros((3, 4, 2)), np.zeros((3, 4, 1))
    b1[0, 2, 0] = -0.25                                           # road velocity of 0.25 m/s
    b2[0, 1, 0], b2[0, 3, 0] = 1 / ms, -1 / mu
    c1, d12 = np.zeros((3, 4, 4)), np.zeros((3, 4, 1))
    c1[:, 0], d12[0, 0, 0] = a[:, 1] / 2.0, 1 / ms / 2.0          # body acceleration over 2 m/s^2
    c1[0, 1, 0], c1[0, 2, 2], d12[0, 3, 0] = 1 / 0.08, 1 / 0.02, 1 / 1000.0
    c2, d21 = np.zeros((3, 1, 4)), np.zeros((3, 1, 2))
    c2[0, 0, 0], d21[0, 0, 1] = 1.0, 0.001
    b1, b2, c1, c2 = b1 / length, b2 * force / length, c1 * length, c2
    d12, d21 = d12 * force, d21 / length
    box = lpv.Scheduling(("spring", "damping"), (-1.0, -1.0), (1.0, 1.0))
    return plant(a, b1, b2, c1, np.zeros((3, 4, 2)), d12, c2, d21, lpv.Polynomial(("spring", "damping"), 1), box)


def near_integrators(noise: float = 0.0) -> GeneralizedPlant:
    """Poles at 2e-7, 1e-5 and 0.12 rad/s, one disturbance, which the measurement shows exactly; noise at the control.

    Data of the test "Numerical difficulties 2" of RobustAndOptimalControl.jl, which states 4.4825150 for SLICOT.
    """
    a = [[0, 1, 0], [-1.2e-6, -0.12001, 0], [-11.2, 0, -2e-7]]
    b1, b2 = np.array([[0.0], [0.0], [1.0]]), np.array([[0.0], [1.0], [0.0]])
    d11, d12, d21 = np.array([[2 / 3], [0.0]]), np.array([[0.0], [1.0]]), np.array([[1.0]])
    if noise:
        b1, d11, d21 = np.hstack([b1, noise * b2]), np.hstack([d11, noise * d12]), np.hstack([d21, [[0.0]]])
    return plant(a, b1, b2, [[-112 / 15, 0, 19.999999866666666], [0, 0, 0]], d11, d12, [[-11.2, 0, 0]], d21)


def helicopter() -> GeneralizedPlant:
    """HE1 of COMPleib (Leibfritz 2004; Singh & Coelho 1984): best known static gain 0.1538, full order 0.0737."""
    r = 1 / np.sqrt(2)
    a = [[-0.0366, 0.0271, 0.0188, -0.4555], [0.0482, -1.01, 0.0024, -4.0208], [0.1002, 0.3681, -0.707, 1.42],
         [0, 0, 1, 0]]
    b1 = [[4.678e-2, 0], [4.572e-2, 9.88e-3], [4.369e-2, 1.11e-3], [-2.179e-2, 0]]
    b2 = [[0.4422, 0.1761], [3.5446, -7.5922], [-5.52, 4.49], [0, 0]]
    return plant(a, b1, b2, r * np.array([[2.0, 0, 0, 0], [0, 1, 0, 0]]), np.zeros((2, 2)), r * np.eye(2),
                 [[0, 1, 0, 0]], np.zeros((1, 2)))
