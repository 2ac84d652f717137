"""Scenes: MuJoCo models of rigs, what is randomised in them, and the demonstrations they allow."""
