"""Model-based controllers: contact forces by convex MPC, joint torques by a whole-body QP."""
