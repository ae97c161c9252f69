"""Files: read whole and bounded, written atomically, as UTF-8."""
