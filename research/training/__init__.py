"""Commands about training: ablations, learning curves, parameter search and publication of policies."""
