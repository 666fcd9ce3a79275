"""What a second of computing buys: every method along its dials, the Pareto front, and the choice from it."""
