"""MAVLink: the simulated vehicle for ground tools, and telemetry logs in and out."""
