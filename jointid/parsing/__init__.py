"""Text files of users, parsed under limits: TOML and XML."""
