"""Commands that measure the numbers in the project's documentation, and write them into its pages."""
