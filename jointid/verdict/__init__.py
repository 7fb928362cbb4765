"""Findings on the data and the answer: rules, each with a figure and a remedy."""
