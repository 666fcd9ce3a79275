"""The two-step graph network: interface displacement, then the volume."""
