"""Kinds of physics that a rig for joints can conceal, each by where it acts.

Most are made by another law than a person would write down first: friction is of bristles, films answer late,
gains fade. A diagnosis must not win by knowing the lab.
"""
