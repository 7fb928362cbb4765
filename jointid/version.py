"""The version, written here once: the build, the command line, results and workers read it."""

__version__ = "0.2.0"
