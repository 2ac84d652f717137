"""Figures: one file a figure, each drawn from a table that is saved beside it."""
