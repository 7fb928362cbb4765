"""Shared by all pages: page frame, sidebar, workspace, charts, Markdown escaping."""
