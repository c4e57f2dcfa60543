"""Files: TOML checked by pydantic, atomic output, packaged data."""
