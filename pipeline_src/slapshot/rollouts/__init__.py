"""Rollouts: fast simulation of hits under randomised conditions, written to a Parquet dataset."""
