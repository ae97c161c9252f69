"""The command `doctor`: finds faults of the installation, a robot or a policy, with causes and remedies."""
