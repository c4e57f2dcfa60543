"""Studies with many runs, or about a unit: campaigns, error budgets, tuning, training, the Allan deviation."""
