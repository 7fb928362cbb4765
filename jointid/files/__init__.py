"""Studies on disk: study.toml, record tables, containers with limits, digest, store."""
