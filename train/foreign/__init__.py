"""What users bring to a training in files of theirs."""
