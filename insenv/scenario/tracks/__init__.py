"""Tracks of one's own: recorded or planned points become the motion of a vehicle."""
