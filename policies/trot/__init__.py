"""Diagonal trot, open loop or with velocity feedback, and the reports of its parameter searches."""
