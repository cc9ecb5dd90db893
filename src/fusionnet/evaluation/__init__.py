"""Measures: translation, detection, and executed success."""
