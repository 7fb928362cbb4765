"""Table columns to motor positions and torques: a guessed mapping that the user corrects."""
