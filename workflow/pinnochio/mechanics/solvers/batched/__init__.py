"""Converged finite elements for whole batches of plans of one patient, in torch: made for a GPU, and the same on a CPU.

Every array ends with the plans, so that neighbouring lanes read neighbouring numbers. Sums run in a fixed order.
"""
