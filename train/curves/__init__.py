"""Learning curves of training runs: success and effort of their validations over steps."""
