"""Text tables: layout, numbers and times of day."""
