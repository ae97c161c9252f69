"""Studies by simulation: each module measures the answer to one question about robots or controllers."""
