"""Diagnosis of an installation, a robot or a policy: faults with causes and remedies."""
