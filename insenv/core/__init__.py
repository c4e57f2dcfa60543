"""Core: tables, models, the ways to run one, counter-based noise.  It knows nothing of navigation."""
