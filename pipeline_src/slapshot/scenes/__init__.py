"""Scenes: what a MuJoCo model of a rig is to later stages, what is randomised in it, domains by name."""
