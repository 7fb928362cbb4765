"""What to know before the answer is trusted: rules, each with its figure and its remedy."""
