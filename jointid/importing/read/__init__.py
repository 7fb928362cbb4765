"""Log files of any format to tables of numbers."""
