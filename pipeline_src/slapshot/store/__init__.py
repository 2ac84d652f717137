"""Data versions: the path of a result is a digest of the code, configuration and data that produced it."""
