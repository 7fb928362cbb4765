"""The next experiment: what it would tell, and which few records would tell most."""
