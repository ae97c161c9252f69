"""Diagonal trot by virtual model control: stance feet act as springs and dampers of the trunk."""
