"""Episodes simulated: one policy on one scenario, side by side, and the batteries of scenarios."""
