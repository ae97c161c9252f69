"""Model-based controllers: convex MPC plans the contact forces, and a whole-body QP computes the joint torques."""
