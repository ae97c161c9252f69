"""The task: observations, rewards, fall detection, and readings for measurement."""
