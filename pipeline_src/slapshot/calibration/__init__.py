"""Are p-values p-values, and do intervals hold what they say? Simulated recordings of which all is known."""
