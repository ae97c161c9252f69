"""Model-based control: convex MPC over one rigid body, and the whole body's joint torques from a second program."""
