"""Searches of parameters by CMA-ES: of the trot and those with feedback, the gaits, getting up."""
