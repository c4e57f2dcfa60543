"""Runs: estimators on one drive, simulated or recorded, with their errors, limits and health."""
