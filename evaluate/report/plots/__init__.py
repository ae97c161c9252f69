"""Plots of the report, drawn with matplotlib and stored as SVG."""
