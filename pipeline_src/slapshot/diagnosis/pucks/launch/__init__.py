"""Swing and contact: how the simulator launches objects, with every effect, and what encoders say of it."""
