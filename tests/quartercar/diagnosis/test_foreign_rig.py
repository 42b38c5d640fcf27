"""The foreign rig: nothing at size 0, passive laws, sizes that only scale, the same data for the same seed."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.foreign_rig import cases, causes, laws, motion, truth

SHORT = {"duration": 2.0, "current": "steps", "motion": "road", "causes": (), "kind": "nothing"}


def made(law: str = "herschel-bulkley", seed: int = 5, **fixed: object) -> cases.World:
    current = "none" if law == "polynomial" else "steps"
    return cases.world(cases.draw(seed, **(SHORT | {"law": law, "current": current} | fixed)))


class TestLaws:
    @pytest.mark.parametrize("law", laws.LAWS)
    def test_sustained_motion_dissipates_what_the_closed_form_says(self, law: str) -> None:
        """Slow and far beyond any memory: F = f + c w for the laws that saturate, whatever their internal state."""
        device = replace(laws.drawn(np.random.default_rng(1), law, law != "polynomial", (0.0, 0.0)), error=0.0)
        n, step, speed = 40_000, 1e-4, 0.4
        v = np.full(n, speed)
        i = np.full(n, 0.5)
        force = device.response(v, np.zeros(n), i, step, {}, (0.0, 0.0, 0.0))[-1]
        viscous, dry = (device.shape[k] + 0.5 * device.shape[k + 1] for k in (0, 2))
        a, b = device.shape[4:6]
        wanted = {"herschel-bulkley": dry * (1 - np.exp(-speed / a)) + viscous * speed**b,
                  "polynomial": dry * 2 / np.pi * np.arctan(speed / 0.02) + viscous * (
                      speed + a * speed**2 + b * speed**3),
                  "dahl": dry + viscous * speed, "bouc-wen": dry + viscous * speed,
                  "lugre": dry * (1 + b * np.exp(-((speed / 0.05) ** 2))) + viscous * speed}[law]
        assert force == pytest.approx(wanted, rel=1e-6)

    @pytest.mark.parametrize("law", laws.LAWS)
    def test_closed_cycles_dissipate(self, law: str) -> None:
        device = replace(laws.drawn(np.random.default_rng(2), law, False, (0.0, 0.0)), error=0.0)
        t = np.arange(0, 4, 1e-4)
        for size in (0.02, 0.2, 2.0):
            v = size * np.sin(2 * np.pi * 2 * t)
            x = -size * np.cos(2 * np.pi * 2 * t) / (4 * np.pi)
            force = device.response(v, x, np.zeros_like(t), 1e-4, {}, (0.0, 0.0, 0.0))
            last = t >= 3.5 - 5e-5
            assert np.sum((force * v)[last]) > 0

    def test_spring_in_series_with_a_dashpot_is_maxwells(self) -> None:
        """F kappa' + F/c = v: amplitude and phase of a sine in closed form."""
        kappa, c, w = 0.02, 0.8, 2 * np.pi * 5
        t = np.arange(0, 4, 1 / 8192)
        device = laws.Device("polynomial", 1.0, 1.0, 1.0, (c, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0.0, ())
        force = device.response(np.sin(w * t), np.zeros_like(t), np.zeros_like(t), 1 / 8192, {},
                                (float(laws.SPRING), kappa, 0.0))
        wanted = (c / (1 + 1j * w * kappa * c) * np.exp(1j * w * t)).imag
        late = t > 2
        assert np.sqrt(np.mean((force - wanted)[late] ** 2)) < 5e-3 * np.sqrt(np.mean(wanted[late] ** 2))

    def test_sizes_only_scale(self) -> None:
        world = made()
        large = replace(world, device=replace(world.device, force=1e3 * world.device.force, speed=world.device.speed))
        clean = world.run()
        small, big = (cases.measured(w, clean) for w in (world, large))
        assert np.allclose(big["force"], 1e3 * small["force"], rtol=1e-12)
        assert np.array_equal(big["x"], small["x"])


class TestCauses:
    @pytest.mark.parametrize("cause", causes.CAUSES, ids=lambda c: c.name)
    def test_size_zero_changes_nothing(self, cause: causes.Cause) -> None:
        world = made()
        plain, hidden = world.run(), world.run(((cause.name, 0.0),))
        assert all(np.array_equal(plain[k], hidden[k]) for k in plain)

    @pytest.mark.thinned(3)
    @pytest.mark.parametrize("cause", causes.CAUSES, ids=lambda c: c.name)
    def test_its_change_vanishes_with_its_size_and_is_reached(self, cause: causes.Cause) -> None:
        bench = truth.bench(made())
        size, change = bench.sized(cause.name, 0.05)
        found = np.sqrt(np.mean(change**2))
        assert np.sqrt(np.mean(bench.change(cause.name, 0.2 * size) ** 2)) < 0.8 * found
        assert 0.005 < found < 0.053

    @pytest.mark.parametrize("name", ["coulomb-friction", "quadratic-loss", "stribeck-friction", "dragged-mass"])
    def test_dry_and_hydraulic_causes_dissipate(self, name: str) -> None:
        world = made()
        added = world.force((causes.cause(name).impose(0.3, world.scene),), world.x, world.v, world.i) - world.force(
            (), world.x, world.v, world.i)
        assert np.mean(added * world.v) > 0

    def test_a_delay_is_a_delay(self) -> None:
        world = made()
        later = world.run((("force-delay", 2 / cases.RATE),))["force"]
        plain = world.run()["force"]
        assert np.allclose(later[10:], plain[8:-2], atol=1e-9 * np.abs(plain).max())


class TestCases:
    def test_same_seed_same_record_other_seed_another(self) -> None:
        first, again, other = (cases.measured(w, w.run()) for w in (made(), made(), made(seed=6)))
        assert all(np.array_equal(first[k], again[k]) for k in first)
        assert not np.array_equal(first["force"], other["force"])

    def test_law_error_is_of_the_size_that_was_drawn(self) -> None:
        assert all(0.009 < truth.law_error(made(law, seed)) < 0.032 for law in laws.LAWS for seed in (1, 2))
        assert 0.028 < truth.law_error(made(kind="rough")) < 0.065

    @pytest.mark.parametrize("kind", motion.MOTIONS)
    def test_motion_has_unit_speed_and_its_velocity(self, kind: str) -> None:
        x, v = motion.motion(kind, 40_000, 8192.0, np.random.default_rng(3))
        assert np.sqrt(np.mean(v**2)) == pytest.approx(1.0)
        assert np.allclose(np.gradient(x, 1 / 8192.0), v, atol=1e-9)

    @pytest.mark.parametrize("colour", cases.COLOURS)
    def test_noise_has_unit_size(self, colour: str) -> None:
        assert np.sqrt(np.mean(cases.noise(colour, 5000, np.random.default_rng(4)) ** 2)) == pytest.approx(1.0)

    @pytest.mark.slow
    def test_a_cause_is_no_rival_of_itself_and_separable_means_apart(self) -> None:
        plan = cases.draw(5, **(SHORT | {"law": "herschel-bulkley", "kind": "single", "causes": ("series-compliance",),
                                         "share": 0.2}))
        found = truth.truth_of(cases.world(plan))
        assert "series-compliance" not in found.rivals
        assert found.separable == (min(found.rivals.values()) >= found.unknown)

    @pytest.mark.slow
    def test_what_is_beyond_half_the_rate_of_the_analysis_is_not_separable(self) -> None:
        """A resonance of 135 Hz, at 512 Hz and at 128 Hz."""
        plan = cases.draw(5, law="herschel-bulkley", kind="single", causes=("fixture-resonance",), share=0.05,
                          level=0.002, duration=4.0)
        full, slow = (truth.truth_of(cases.world(plan), rate) for rate in (cases.RATE, cases.RATE / 4))
        assert full.hidden == slow.hidden
        assert full.separable and not slow.separable

    @pytest.mark.slow
    @pytest.mark.parametrize(("seed", "alike"), [
        (5700004, {"displacement-delay", "one-sided-filter"}), (5700008, {"thermal-fade", "viscous-fade"})])
    def test_what_the_truth_calls_inseparable_is_listed_together(self, seed: int, alike: set[str], tmp_path: Path
                                                                  ) -> None:
        """Two causes of which the rig's own law says that they differ by less than its error."""
        import lpvid as lpv

        plan = cases.draw(seed, duration=10.0)
        world = cases.world(plan)
        known = truth.truth_of(world, cases.RATE / 2)
        assert {*plan.causes, *(n for n, d in known.rivals.items() if d < known.unknown)} >= alike
        path = tmp_path / "record.csv"
        cases.written(world, cases.measured(world, world.run(known.hidden)), path)
        answer = lpv.diagnose(lpv.read(str(path)), plan.baseline, sample_rate=cases.RATE / 2)
        assert not alike & {c.name for c in answer.causes}
        assert any(alike <= set(r.names) for r in answer.rivals)

    @pytest.mark.slow
    def test_play_beside_friction_is_listed_with_a_dead_zone_of_the_force(self, tmp_path: Path) -> None:
        """A play of 11 % of the force beside LuGre's friction, with Guo's law as the baseline."""
        import lpvid as lpv

        world = cases.world(cases.draw(67700007))
        assert world.plan.causes == ("backlash",) and world.plan.law == "lugre"
        path = tmp_path / "record.csv"
        cases.written(world, cases.measured(world, world.run(truth.truth_of(world).hidden)), path)
        answer = lpv.diagnose(lpv.read(str(path)), "guo", sample_rate=cases.RATE / 2)
        assert not {"backlash", "force-dead-zone"} & {c.name for c in answer.causes}
        assert any({"backlash", "force-dead-zone"} <= set(r.names) for r in answer.rivals)

    def test_shares_no_code_with_what_it_judges(self) -> None:
        for path in Path(causes.__file__).parent.glob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                names = [a.name for a in node.names] if isinstance(node, ast.Import) else (
                    [node.module or ""] if isinstance(node, ast.ImportFrom) else [])
                assert not any(n.startswith(("quartercar", "lpvid")) for n in names), path
