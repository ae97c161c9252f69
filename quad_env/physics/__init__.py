"""Physics: the compiled MuJoCo model, the simulation of n robots, the state of the robots, and rendering."""
