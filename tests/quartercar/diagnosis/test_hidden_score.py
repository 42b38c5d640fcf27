"""Marks of the scoreboard: what is separable follows from the truth alone, and what is listed is not named."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from helpers import hidden_score, hidden_truth

from quartercar.effects import CATALOGUE

FEW = tuple(e for e in CATALOGUE if e.name in ("coulomb-friction", "gas-stiffness", "stribeck-friction"))
QUIET = {"kind": "one", "causes": ("coulomb-friction",), "baseline": "guo", "excitation": "road",
         "current": "random steps", "level": 0.005, "colour": "white", "chain": "clean", "repeats": False,
         "duration": 6.0, "law": "rig", "ratio": 30.0}


def answer(named: tuple[str, ...] = (), rivals: tuple[tuple[str, ...], ...] = ()) -> SimpleNamespace:
    """As much of a diagnosis as a row reads."""
    causes = [SimpleNamespace(name=n, parameters=(), delta_bic=-20.0, contribution=0.1) for n in named]
    return SimpleNamespace(weights=None, verdict="cannot-tell", reason="", causes=causes,
                           rivals=[SimpleNamespace(names=r) for r in rivals], rejected=[], explained_share=None,
                           noise={"predictable_share": 0.0}, gain_percent=0.0, extended=None)


@pytest.fixture(scope="module")
def built() -> tuple:
    """A case and what its data could tell, before anything is diagnosed."""
    return hidden_truth.build(31, FEW, **QUIET)


@pytest.mark.parametrize("stated", [answer(("coulomb-friction",)), answer(),
                                  answer(rivals=(("coulomb-friction", "stribeck-friction"),))])
def test_what_is_separable_does_not_depend_on_the_answer(monkeypatch: pytest.MonkeyPatch, built: tuple,
                                                         stated: SimpleNamespace) -> None:
    truth = built[1]
    monkeypatch.setattr(hidden_score, "build", lambda *_, **__: built)
    monkeypatch.setitem(hidden_score.ENGINES, "gates", lambda *_: stated)
    monkeypatch.setattr(hidden_score, "oracle_gain", lambda *_: (0.0, 1.0))
    row = hidden_score.case(31, FEW, **QUIET)
    assert row["separable"] == truth.separable
    assert row["ambiguous"] == truth.ambiguous
    assert row["near"] == truth.rivals
    assert truth.separable or truth.ambiguous  # thirty times what can be seen: one of the two


def row(causes: tuple[str, ...], named: tuple[str, ...], rivals: tuple[tuple[str, ...], ...] = ()) -> dict:
    """A row of several causes, all of them large."""
    return {"kind": "three", "chain": "clean", "causes": causes, "named": list(named), "near": {},
            "rivals": [list(r) for r in rivals], "besides": [0.1] * len(causes)}


def test_a_separable_cause_among_rivals_is_not_named() -> None:
    two = ("coulomb-friction", "coil-lag")
    assert hidden_score.exact(row(two, two))
    listed = row(two, ("coulomb-friction",), (("coil-lag", "command-delay"),))
    assert hidden_score.contained(listed)
    assert not hidden_score.exact(listed)


def test_a_constant_force_may_have_either_name() -> None:
    two = ("coulomb-friction", "force-offset")
    assert hidden_score.exact(row(two, ("coulomb-friction", "gas-preload")))
    assert hidden_score.exact(row(two, ("coulomb-friction",), (("gas-preload", "force-offset"),)))
    assert not hidden_score.exact(row(two, ("coulomb-friction",), (("gas-preload", "force-offset", "asymmetry"),)))
    assert not hidden_score.exact(row(two, (*two, "end-stop")))
