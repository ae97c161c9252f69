"""Search of policy parameters by the evolution strategy CMA-ES.

The package contains the search algorithm, the simulated trials with their costs, and the search of a trot.
"""
