"""Training of SimpleQuad policies with Stable-Baselines3's PPO; `python -m train --help`."""
