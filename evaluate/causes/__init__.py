"""Causes of failed episodes, such as a trip or a slip; rules determine them from the recorded signals."""
