"""Evaluation of dampers: free-run figures, energy and passivity, the comparison of models."""
