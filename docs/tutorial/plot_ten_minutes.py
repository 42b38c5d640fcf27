"""
Ten minutes with a damper
=========================

You have records of a damper whose force depends on how it moves and on a current. You want a model that predicts the
force, figures of its accuracy, and a statement about its stability while the current moves. Everything below
runs as it stands; copy it line by line.

The data are **virtual**. The rig of ``quartercar`` simulates a magneto-rheological damper with a coil and a measurement
chain. It stands in for your own test bench.
"""

# %%
# 1. Records
# ----------
# Two runs of 15 seconds on a random road at 512 Hz. In ``test-1`` the current takes a new random value every 20 ms,
# in ``test-3`` it switches at random times to random values. Your own data are one call: ``lpv.read("run*.csv")``,
# with headers such as ``velocity [mm/s]``.

import tempfile
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt

import lpvid as lpv
from lpvid import plot
from lpvid.condition import split_tail
from quartercar.rig import EXPERIMENTS, Rig

rig = Rig()
records = [rig.run(replace(EXPERIMENTS[name], duration=15.0), seed=7) for name in ("test-1", "test-3")]
print(*records, sep="\n")

# %%
# 2. Look before you fit
# ----------------------
# The audit looks for gaps, reversed signs, clipped channels, inputs that cannot be separated and more. Every
# finding has its evidence and its mend.

print(lpv.audit(records))

# %%
# Force over velocity shows what a damper does: the width of the loop is memory, the height depends on the current.

fig, ax = plt.subplots(figsize=(7, 3.4), layout="constrained")
points = ax.scatter(records[1]["velocity"], records[1]["force"], c=records[1]["current"], s=2)
fig.colorbar(points, label="current [A]")
ax.set(xlabel="velocity [m/s]", ylabel="force [N]", title="Virtual rig, test-3")

# %%
# 3. Keep data back
# -----------------
# The last third of every record stays out of the fit. What is reported as *held-out* was never seen.

pairs = [split_tail(record) for record in records]
training, held_out = [first for first, _ in pairs], [last for _, last in pairs]

# %%
# 4. Identify
# -----------
# Fourth order, coefficients affine in the current, with a fitted tanh stage for the saturating force. ``nk=0`` lets
# the velocity act within one sample.

structure = lpv.ARX(na=4, nb=4, nk=0, input="velocity", output="force", stage="tanh", affine=1,
                    basis=lpv.Polynomial("current", degree=1))
found = lpv.identify(training, structure, held_out=held_out)
print(found)

# %%
# 5. Believe the free run
# -----------------------
# A *one-step* prediction uses the measured force of the last sample. A *free run* uses the inputs only, as a
# simulation or a controller does. ESR is the energy of the error over the energy of the force about its mean: 0 is
# perfect, 1 is no better than the mean.

shown = plot.compare(found.model, held_out[0], "held-out")
plot.show(plot.free_run(shown, scheduling=["current"]))

# %%
# 6. A better estimate
# --------------------
# Least squares weighs one-step errors. ``OutputError`` minimises the error of the free run itself, from the same
# structure, and here it also fits the lag between the commanded and the effective current.

better = lpv.identify(training, lpv.OutputError(na=2, nb=2, nk=0, input="velocity", output="force", stage="tanh",
                                                basis=lpv.Polynomial("current", degree=1), schedule_filter="lag"),
                      held_out=held_out)
print(better)

# %%
# 7. Stability
# ------------
# Three questions that are easy to confuse. Where are the poles at each constant current? At which current
# does the frozen model turn unstable? Does every motion die out while the current moves?

print(lpv.critical_scheduling(found.model))
plot.show(plot.locus(lpv.pole_locus(found.model), critical=lpv.critical_scheduling(found.model)))

# %%
# Only the third is a statement about a current that moves. The certificate is checked again with numpy alone,
# without the solver that proposed it.

certificate = lpv.certify_stability(found.model)
print(certificate)
print(lpv.verify(certificate, found.model))

# %%
# 8. Keep it
# ----------
# The file holds the model with its units, ranges and covariance. ``lpvid validate damper.json run9.csv`` reads it
# back.

path = Path(tempfile.mkdtemp()) / "damper.json"
lpv.save(found.model, path)
print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB")

# %%
# 9. Why does a simpler law miss something?
# -----------------------------------------
# Another damper of the rig follows Guo's law, but has dry friction that the law lacks. The diagnosis fits the law,
# looks at what is left, and asks every candidate cause whether it is behind it. It names one only where the data
# leave no other, and else reports which measurement is missing. Four candidates keep this page short;
# ``qc.effects.CATALOGUE`` has all.

import quartercar as qc
from quartercar.rig import RigDamper, effect

sticking = Rig(damper=RigDamper.static(), effects=(effect("coulomb-friction"),))
record = sticking.run(replace(EXPERIMENTS["test-3"], duration=10.0), seed=1)
few = [e for e in qc.effects.CATALOGUE if e.name in ("coulomb-friction", "gas-stiffness", "coil-lag", "asymmetry")]
print(lpv.diagnose(record, "guo", few))

# %%
# Where to go from here
# ---------------------
# Your own question is probably one of the how-to pages. The explanations give reasons: why a free run, why a
# certificate, and how the diagnosis decides.
