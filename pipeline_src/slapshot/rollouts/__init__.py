"""Rollouts: hits under randomised conditions, fast, to a Parquet dataset."""
