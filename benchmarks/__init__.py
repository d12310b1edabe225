"""Cost of the parts: ``python -m benchmarks``."""
