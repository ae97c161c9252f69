"""Causes of failed episodes, such as a trip or a slip, determined by rules on the recorded signals."""
