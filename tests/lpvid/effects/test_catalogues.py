"""Baselines and catalogues of installed packages."""

from __future__ import annotations

import pytest
from helpers.toy_viscous import Added, Point, Viscous, pretend_installed, sign

from lpvid.baselines.named import factories, named_baseline
from lpvid.effects.catalogues import catalogue
from lpvid.errors import InputError


@pytest.fixture
def installed(monkeypatch):
    return pretend_installed(monkeypatch)


def test_entry_points_may_give_a_factory_or_a_mapping_of_them(installed):
    installed["lpvid.baselines"].append(Point("house", {"a": lambda r, p=None: Viscous(1.0),
                                                        "b": lambda r, p=None: Viscous(2.0)}))
    assert named_baseline("b", ()).vector == [2.0] and set(factories()) == {"viscous", "a", "b"}
    installed["lpvid.effects"].append(Point("more", (Added("lone", sign),)))
    assert [e.name for e in catalogue()] == ["lone", "dry", "square", "spring", "heat"]
    assert [e.name for e in catalogue(["more"])] == ["lone"]


@pytest.mark.parametrize(("group", "value", "stated"), [
    ("lpvid.effects", ImportError("broken\nmodule"), "does not load; broken module"),
    ("lpvid.effects", (1, 2), "no tuple of effects"),
    ("lpvid.effects", (Added("dry", sign),), "two effects have one name"),
    ("lpvid.baselines", {"x": 3}, "gives no factory for 'x'"),
    ("lpvid.baselines", {"viscous": Viscous}, "two installed baselines are called 'viscous'"),
])
def test_a_package_that_names_nonsense_is_told(installed, group, value, stated):
    installed[group].append(Point("odd", value))
    with pytest.raises(InputError) as error:
        catalogue() if group == "lpvid.effects" else factories()
    assert stated in str(error.value) and "\n" not in str(error.value)
