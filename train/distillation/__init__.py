"""Distillation: a network, the student, learns to imitate another policy, the teacher.

The method is dataset aggregation (DAgger): the student controls the simulated robots for a growing part of the time.
The label of each visited state is the action that the teacher would choose, and the student learns from all labels.
"""
