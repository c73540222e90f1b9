"""Verification: what must be true of laws and motions, our numbers beside those of others."""
