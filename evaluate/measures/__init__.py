"""What an episode measured: tracking, effort, gait, pushes, standing still, a residual's use of its authority."""
