"""Metrics, significance tests and tables."""
