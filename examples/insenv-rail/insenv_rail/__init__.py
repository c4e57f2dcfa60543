"""A trolley on a rail, its compass, and an attitude and heading reference system."""
