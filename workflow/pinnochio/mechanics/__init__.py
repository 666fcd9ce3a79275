"""Nearly incompressible hyperelasticity on tetrahedra: energy, residual, solver, sliding."""
