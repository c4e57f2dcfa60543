from interpreted import interpreted  # noqa: F401
