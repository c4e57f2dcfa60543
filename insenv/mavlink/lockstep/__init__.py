"""Lockstep with an autopilot."""
