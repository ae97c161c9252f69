"""Search of parameters by CMA-ES: one search, over a table of subjects."""
