"""What becomes of a finished run: a shipped bundle with its card, an ONNX file."""
