"""Model-based controllers: contact forces by convex MPC of a rigid body, joint torques by a whole-body QP."""
