"""Motion state of the robots, and estimates of the forces on their feet; contact sensors are not needed."""
