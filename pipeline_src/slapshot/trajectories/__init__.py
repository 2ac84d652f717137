"""Trajectories: scripted demonstrations, a VAE over them, and the swings that are safe to execute."""
