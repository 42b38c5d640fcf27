"""Diagnosis: what a simulation gets wrong, its cause by name, the extended model and its gain.

`lpvid.diagnose` is the front door (`lpvid.diagnosis.facade`); `Effect` and `Baseline` are the two contracts that other
packages fill in.
"""
