"""Every method that predicts: finite elements, graph networks, surface networks, regressions and floors."""
