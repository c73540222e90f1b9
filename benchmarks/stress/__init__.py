"""What becomes of scenes at the edge and beyond: python -m benchmarks problem=stress."""
