"""The stages that solve plans by finite elements."""
