"""Diagnosis: what a simulation gets wrong, its cause by name, the extended model and its gain.

`lpvid.diagnose` is the front door. To read how it decides, in the order in which it works::

    facade ─► task (automatic) ─► evidence.engine
      evidence.thinning, problem, blocks, noise         data: few samples, in blocks that count as independent
      refitting, trial_steps                            fit: baseline and effects together, on free-run errors
      evidence.search, .visited                         search over sets of effects
        screening, start_points, evidence.candidates    which effects to add, and from where
        evidence.laplace, .priors, .discrepancy         evidence of a set: model, priors, misfit of the law
        evidence.effective_samples, .relations          what an error counts as; which effects share a set
      evidence.selection, folds, remainder              the set to report, confirmed out of fold
        evidence.weighed_sets, .members                 weights of what is confirmed; what of the set is named
      evidence.calibration, .rivals                     from weights to probabilities and names
      evidence.outcome, localise, estimates, intervals  the verdict
    diagnosis, experiments, interrupted                 the result, and what to measure next

What an effect and a baseline are stands below, in `lpvid.effects` and `lpvid.baselines`.
"""
