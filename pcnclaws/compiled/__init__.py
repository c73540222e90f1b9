"""The step and the laws as C++ kernels for the CPU, with their adjoints and directional derivatives."""
