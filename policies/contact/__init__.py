"""Motion state of the robots, and estimates of the foot forces that need no contact sensors."""
