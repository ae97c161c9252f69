"""What every benchmark shares: options, bars, measuring, progress, bare MuJoCo."""
