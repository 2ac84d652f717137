"""The search for what is missing: candidates, tests, refits."""
