"""Equations that several estimators share."""
