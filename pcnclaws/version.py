"""The version of the package, which everything may name without importing what is above it."""

__version__ = "0.1.0"
