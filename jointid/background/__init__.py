"""Calls in background processes that can be cancelled."""
