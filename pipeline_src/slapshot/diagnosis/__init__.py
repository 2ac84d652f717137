"""Diagnosis: identify which physics a model lacks, at which part and of what size, from a recording.

This package diagnoses joints and bodies; `pucks` diagnoses hits of a sliding object.
"""
