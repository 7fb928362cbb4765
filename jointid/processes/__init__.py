"""Work in processes of their own: they can be ended, and leave this one's interpreter free."""
