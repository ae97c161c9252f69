"""Model-based control: convex MPC of a single rigid body, and a whole-body QP for the joint torques."""
