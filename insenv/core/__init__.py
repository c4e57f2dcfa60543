"""Core: tables, models, the ways to run a model, counter-based noise.  It contains no navigation."""
