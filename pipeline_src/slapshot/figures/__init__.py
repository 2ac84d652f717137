"""Figures: one file for each figure, drawn from a table that is saved beside it."""
