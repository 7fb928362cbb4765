"""What every page uses: page frame, sidebar, workspace, charts, Markdown escaping."""
