"""Reading of files up to a size limit, atomic writing of files, and short texts that are safe to print."""
