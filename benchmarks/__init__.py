"""Benchmarks of the documentation: jointid compared with other software."""
