"""Ways to equilibrium: Newton, kept factors, linear elasticity, parts of a mesh, corrections, repair, batches."""
