"""Trajectories: scripted demonstrations, a VAE trained on them, and swings that are safe to execute."""
