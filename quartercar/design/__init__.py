"""Suspension design: from a configuration to a controller with its verified closed loop, its figures and its report."""
