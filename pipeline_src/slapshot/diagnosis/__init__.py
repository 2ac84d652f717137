"""Diagnosis: from a recording that a scene does not explain to what was left out, where, and how much.

`pucks` reads recordings of objects that are hit and slide.
"""
