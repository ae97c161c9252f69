"""Diagnosis of an installation, a robot or a policy: faults with their causes and remedies, root causes first."""
