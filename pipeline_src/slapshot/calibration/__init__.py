"""Calibration of p-values and coverage of intervals, from simulated recordings with known truth."""
