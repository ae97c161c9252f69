"""The mistakes of a user that any package can find."""


class UserError(Exception):
    """A user's mistake; its text is one line that names the remedy."""
