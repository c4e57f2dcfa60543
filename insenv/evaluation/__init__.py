"""Evaluation: everything that judges an estimate."""
