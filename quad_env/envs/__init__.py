"""The Gymnasium environments: one robot, or a native batch of n."""
