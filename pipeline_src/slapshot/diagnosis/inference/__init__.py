"""Inference from whitened residuals and columns, independent of physics."""
