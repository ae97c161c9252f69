"""Distillation: a network learns from a teacher's labels on the states that it visits itself (DAgger)."""
