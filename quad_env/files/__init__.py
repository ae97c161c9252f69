"""Reading of files up to a size limit, atomic writing of files, and safe texts for messages."""
