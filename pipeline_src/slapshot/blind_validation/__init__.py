"""Blind validation: cases with concealed physics are recorded by the lab, diagnosed, and then scored.

Lab and diagnosis are independent; the scores are computed from the files that they wrote.
"""
