"""Search of policy parameters by CMA-ES: the search itself, its trials and costs, and the search of a trot."""
