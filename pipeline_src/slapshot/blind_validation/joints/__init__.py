"""Blind validation for joints: cases of the joint lab, diagnosed by the joint engine, then scored."""
