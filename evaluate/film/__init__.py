"""Films and pictures of episodes: frames, what is drawn into them, captions, side by side, and files."""
