"""Physics: the compiled MuJoCo model, n robots stepped together, their state, and pictures of them."""
