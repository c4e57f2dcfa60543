"""Runs: estimators on simulated or recorded data, with their errors and theoretical limits."""
