"""Scenes: the MuJoCo model of a rig for all later stages, domain randomisation, and the lookup of domains."""
