"""User interface shared by the pages; only it and the pages import streamlit."""
