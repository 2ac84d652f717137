"""Fits of hits: launches, friction and effects in one likelihood."""
