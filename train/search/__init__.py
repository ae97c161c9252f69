"""Searches of parameters by CMA-ES: of the trot, its feedback, the gaits, getting up."""
