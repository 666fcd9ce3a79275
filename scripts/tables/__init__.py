"""The stages that measure and tabulate."""
