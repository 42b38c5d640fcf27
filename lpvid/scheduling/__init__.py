"""Scheduling variables, and the bases in which coefficients depend on them: one basis per file."""

from __future__ import annotations

from lpvid.scheduling.basis import Basis
from lpvid.scheduling.fourier import Fourier
from lpvid.scheduling.polynomial import Polynomial
from lpvid.scheduling.product import Product
from lpvid.scheduling.shifted import Shifted
from lpvid.scheduling.spline import Spline
from lpvid.scheduling.stacked import Stacked
from lpvid.scheduling.variables import Scheduling

__all__ = ["Basis", "Fourier", "Polynomial", "Product", "Scheduling", "Shifted", "Spline", "Stacked",
           "basis_from_dict"]

basis_from_dict = Basis.from_dict
"""a basis of any kind from its plain data"""
