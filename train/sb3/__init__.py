"""Training with Stable-Baselines3: environment adapter, PPO, callbacks, checkpoints."""
