"""Functions that read files up to a size limit, write files atomically, and make texts safe to print."""
