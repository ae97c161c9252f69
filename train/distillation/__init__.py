"""Distillation: a network, the student, learns to imitate another policy, the teacher.

The method is dataset aggregation (DAgger): the student controls the simulated robots for a growing part of the time.
The teacher labels every visited state with its own action, and the student learns from all labels.
"""
