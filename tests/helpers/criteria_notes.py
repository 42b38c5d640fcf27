"""Figures out of the notes of a design under several criteria."""

from __future__ import annotations


def promised(result, k=0):
    """The figure of the k-th criterion that the inequalities promised."""
    return float(result.notes[k].split("promised ")[1].split(")")[0])


def verified(result, k=0):
    """The figure of the k-th criterion as verified."""
    return float(result.notes[k].split("at most ")[1].split(" ")[0])
