"""Training with Stable-Baselines3 (SB3): environment adapter, PPO, callbacks and checkpoints."""
