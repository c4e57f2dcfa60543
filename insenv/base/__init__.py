"""What all of insenv stands on: errors, TOML checked by pydantic, atomic output, packaged data, plug-ins, the version."""
