"""Scheduling variables, and the bases in which coefficients depend on them: one basis per file."""

from __future__ import annotations

from collections.abc import Mapping

from lpvid.errors import InputError
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


def basis_from_dict(data: Mapping) -> Basis:
    """Rebuild a basis from `Basis.to_dict`."""
    kind = data.get("kind")
    if kind == "polynomial":
        return Polynomial(tuple(data["names"]), data["degree"], tuple(data["centre"]), tuple(data["half_width"]))
    if kind == "spline":
        return Spline(data["name"], data["segments"], data["order"], tuple(data["knots"]))
    if kind == "product":
        return Product(basis_from_dict(data["first"]), basis_from_dict(data["second"]))
    if kind == "stacked":
        return Stacked(tuple(basis_from_dict(f) for f in data["factors"]))
    if kind == "shifted":
        return Shifted(basis_from_dict(data["basis"]), data["lag"])
    if kind == "fourier":
        return Fourier(data["name"], data["harmonics"], data["period"], data["origin"])
    raise InputError("unknown basis in a model file", got=kind)
