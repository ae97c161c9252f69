"""Training with Stable-Baselines3 (SB3): adapter of the environment, PPO, callbacks, logs and checkpoints."""
