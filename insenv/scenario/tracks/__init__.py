"""Tracks: recorded or planned points become the motion of a vehicle."""
