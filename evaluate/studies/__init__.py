"""Studies of one subject each: gaits, recovery, jump, safety layer, pictures."""
