"""Damper laws with physical parameters, one model per file, with their compiled kernels and starting points."""
