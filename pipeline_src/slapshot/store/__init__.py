"""Data versions: the path of a result is the digest of everything that made it."""
