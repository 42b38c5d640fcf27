"""Baselines for the diagnosis: damper models, saved LPV models, a linear mechanical one, the quarter car."""
