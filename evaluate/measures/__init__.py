"""What an episode measured: tracking, effort, gait, pushes."""
