"""Physics: the compiled MuJoCo model, the simulation of n robots, their state, and rendering."""
