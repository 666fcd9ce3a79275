"""Studies beyond the comparison of methods: stability, scaling, trade-off, model reduction."""
