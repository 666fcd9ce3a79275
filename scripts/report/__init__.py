"""The stages that report."""
