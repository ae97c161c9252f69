"""Model-based control: convex MPC of a single rigid body, and joint torques from a whole-body quadratic program."""
