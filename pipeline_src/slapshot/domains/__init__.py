"""Domains: one folder each, with a robot, its scene and demonstrations (see scenes/domain.py)."""
