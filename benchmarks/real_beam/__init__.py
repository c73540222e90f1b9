"""The measured beam: E and viscosity from one recording of motion capture, the next recording predicted."""
