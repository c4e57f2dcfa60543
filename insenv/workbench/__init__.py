"""The workbench: from a log or a scenario to a decision."""
