"""The task: observations, rewards, falls, and readings for measurement."""
