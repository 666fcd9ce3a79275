"""Surgical plans: one rigid motion per bone segment, read, written, sampled and taken apart."""
