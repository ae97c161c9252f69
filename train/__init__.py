"""Training of SimpleQuad policies with PPO of Stable-Baselines3; `python -m train --help` lists the commands."""
