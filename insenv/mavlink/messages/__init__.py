"""MAVLink messages: what each holds and when it is due."""
