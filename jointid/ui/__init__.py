"""What the pages share; streamlit lives here and in the pages only."""
