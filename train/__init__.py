"""Training of SimpleQuad policies with PPO of Stable-Baselines3; see `python -m train --help`."""
