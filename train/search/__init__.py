"""Search of policy parameters by CMA-ES: the algorithm, trials and costs, and a search of a trot."""
