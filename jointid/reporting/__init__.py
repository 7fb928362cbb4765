"""The report: one set of drawings, as one HTML file or as PDF."""
