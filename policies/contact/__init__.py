"""Motion state of the robots and the forces on their feet, from observations without contact sensors."""
