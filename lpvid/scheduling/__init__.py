"""Scheduling variables, and the bases in which coefficients depend on them: one basis per file."""

from __future__ import annotations

from lpvid.scheduling.algebra import common, products
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

Basis.product = lambda first, second: products(first, second)[0]
Basis.stack = lambda first, second: common(first, second)[0]
Basis.delayed = Shifted

basis_from_dict = Basis.from_dict
"""a basis of any kind from its plain data"""
