"""Significance tests, conformal half-widths, intervals and fits; knows no method."""
