"""Domains: a folder each, with a robot, its scene and demonstrations (see scenes/domain.py)."""
