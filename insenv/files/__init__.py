"""Files: TOML checked by pydantic, the one atomic writer, packaged data."""
